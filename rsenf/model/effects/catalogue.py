"""Effects by name: those of this package, and an expert's own."""

from __future__ import annotations

import difflib
import importlib.util
import inspect
import sys
from pathlib import Path
from typing import Any

from rsenf.errors import UsageError
from rsenf.model import parameters
from rsenf.model.effects.auto_exposure import AutoExposure
from rsenf.model.effects.base import Effect
from rsenf.model.effects.capture_jitter import CaptureJitter
from rsenf.model.effects.clock_skew import ClockSkew
from rsenf.model.effects.codec_lowpass import CodecLowpass
from rsenf.model.effects.exposure import Exposure
from rsenf.model.effects.frame_drop import FrameDrop
from rsenf.model.effects.frame_duplicate import FrameDuplicate
from rsenf.model.effects.gamma import Gamma
from rsenf.model.effects.gop_attenuation import GopAttenuation
from rsenf.model.effects.harmonics import Harmonics
from rsenf.model.effects.image_wobble import ImageWobble
from rsenf.model.effects.interharmonic import Interharmonic
from rsenf.model.effects.interlace import Interlace
from rsenf.model.effects.moving_object import MovingObject
from rsenf.model.effects.pwm_tone import PwmTone
from rsenf.model.effects.readout_drift import ReadoutDrift
from rsenf.model.effects.reverse_readout import ReverseReadout
from rsenf.model.effects.row_banding import RowBanding
from rsenf.model.effects.rows_cropped import RowsCropped
from rsenf.model.effects.second_lamp import SecondLamp
from rsenf.model.effects.timestamp_jitter import TimestampJitter
from rsenf.model.effects.variable_frame_rate import VariableFrameRate
from rsenf.model.parameters import KeyPath, ParameterError

# In the order in which light and frames meet them.
CATALOGUE: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        ClockSkew, VariableFrameRate, CaptureJitter,
        Exposure, RowsCropped, ReadoutDrift, ReverseReadout, Interlace, ImageWobble,
        Harmonics, SecondLamp, PwmTone, Interharmonic, MovingObject,
        AutoExposure, Gamma, RowBanding,
        FrameDrop, FrameDuplicate, TimestampJitter,
        GopAttenuation, CodecLowpass,
    )
}  # fmt: skip

_TOLD = ("__doc__", "name", "source", "confused_with", "told_apart_by")


def make_effect(name: str, values: Any, path: KeyPath = ()) -> Effect:
    """Build an effect of the catalogue from plain values; what isn't given keeps its default.

    Parameters
    ----------
    name : str
        Of the effect.
    values : dict
        Its parameters.
    path : tuple, optional
        Where they stand in a model file; ``effects.<name>`` unless given.

    Raises
    ------
    ParameterError
        For an unknown effect or parameter, with the nearest there is, or a value that isn't
        plausible.
    """
    path = path or ("effects", name)
    if name not in CATALOGUE:
        near = difflib.get_close_matches(name, CATALOGUE, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(CATALOGUE)}"
        raise ParameterError(path, "is no effect", hint)
    return parameters.from_dict(CATALOGUE[name], values, path)


def read_effects(data: Any) -> tuple[Effect, ...]:
    """Read the ``effects`` of a model file: a list of ``name: {parameter: value}``.

    Raises
    ------
    ParameterError
        For an unknown effect or parameter, or a value that isn't plausible.
    """
    if not isinstance(data, list | tuple):
        raise ParameterError(("effects",), f"is {data!r}, not a list", "- exposure: {…}")
    return tuple(_read(entry, ("effects", n)) for n, entry in enumerate(data))


def write_effects(effects: tuple[Effect, ...]) -> list[dict[str, Any]]:
    """Return effects as a model file holds them."""
    return [{effect.name: effect.to_dict()} for effect in effects]


def register(effect: type[Effect]) -> None:
    """Add an effect to the catalogue; the same name again replaces it.

    Raises
    ------
    UsageError
        When it doesn't say what every effect says of itself.
    """
    missing = [what for what in _TOLD if not getattr(effect, what, None)]
    missing += ["apply"] if inspect.isabstract(effect) else []
    if missing:
        raise UsageError(
            f"the effect {effect.__name__} lacks {', '.join(missing)}",
            "configs/model/my_effect.py is a template",
        )
    CATALOGUE[effect.name] = effect


def load_effects(path: Path) -> list[type[Effect]]:
    """Run a Python file and add the effects that it defines.

    Raises
    ------
    UsageError
        When it can't be run, or defines none.
    """
    spec = importlib.util.spec_from_file_location(f"rsenf_effects_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise UsageError(f"{path}: not a Python file", "name one that ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as exc:  # whatever a stranger's file does
        raise UsageError(f"{path}: can't be run: {type(exc).__name__}: {exc}") from exc
    found = [
        held
        for held in vars(module).values()
        if inspect.isclass(held) and issubclass(held, Effect) and held.__module__ == spec.name
    ]
    if not found:
        raise UsageError(f"{path}: defines no effect", "configs/model/my_effect.py is a template")
    for effect in found:
        register(effect)
    return found


def _read(entry: Any, path: KeyPath) -> Effect:
    if not isinstance(entry, dict) or len(entry) != 1:
        raise ParameterError(path, f"is {entry!r}, not one 'name: {{parameter: value}}'")
    ((name, values),) = entry.items()
    return make_effect(str(name), {} if values is None else values, (*path, str(name)))
