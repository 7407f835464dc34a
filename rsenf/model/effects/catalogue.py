"""The catalogue of effects by name: those of this package, and user-defined ones."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from pathlib import Path
from typing import Any

from rsenf.errors import UsageError
from rsenf.model import parameters
from rsenf.model.effects.base import Effect
from rsenf.model.parameters import KeyPath, ParameterError
from rsenf.registry import Registry

_TOLD = ("__doc__", "name", "source", "confused_with", "told_apart_by")
# By file, in the order in which light and frames pass them; the class has the effect's name.
_OWN = {
    "shutter": (
        "clock_skew", "variable_frame_rate", "capture_jitter", "exposure", "rows_cropped",
        "readout_drift", "reverse_readout", "interlace", "image_wobble",
    ),
    "light": ("harmonics", "second_lamp", "pwm_tone", "interharmonic"),
    "scene": ("moving_stripes", "moving_object"),
    "sensor": ("auto_exposure", "gamma", "row_banding"),
    "delivery": ("frame_drop", "frame_duplicate", "rate_conversion", "timestamp_jitter"),
    "codec": ("gop_attenuation", "codec_lowpass"),
}  # fmt: skip


def _check(name: str, effect: type[Effect]) -> None:
    """Check that an effect declares what every effect must."""
    if not (inspect.isclass(effect) and issubclass(effect, Effect)):
        raise UsageError(f"{name} is no rsenf.model.effects.Effect")
    missing = [what for what in _TOLD if getattr(effect, what, None) in (None, "")]
    missing += ["apply"] if inspect.isabstract(effect) else []
    if missing:
        raise UsageError(
            f"the effect {effect.__name__} lacks {', '.join(missing)}",
            "configs/model/my_effect.py is a template",
        )
    if effect.name != name:
        raise UsageError(f"the effect {effect.name} is added as {name}", "give both one name")


CATALOGUE: Registry[type[Effect]] = Registry(
    "effect",
    "rsenf.effects",
    {
        name: f"rsenf.model.effects.{file}:{name.title().replace('_', '')}"
        for file, names in _OWN.items()
        for name in names
    },
    _check,
)


def make_effect(name: str, values: Any, path: KeyPath = ()) -> Effect:
    """Build an effect of the catalogue from plain values; missing ones keep their default.

    Parameters
    ----------
    name : str
        Of the effect.
    values : dict
        Its parameters.
    path : tuple, optional
        Its place in a model file; by default ``effects.<name>``.

    Raises
    ------
    ParameterError
        For an unknown effect or parameter, with the nearest known one, or a value out of range.

    Examples
    --------
    >>> make_effect("exposure", {"exposure_s": 0.01})
    Exposure(exposure_s=0.01)
    """
    path = path or ("effects", name)
    if name not in CATALOGUE:
        raise ParameterError(path, "is no effect", CATALOGUE.hint(name))
    return parameters.from_dict(CATALOGUE[name], values, path)


def read_effects(data: Any) -> tuple[Effect, ...]:
    """Read the ``effects`` of a model file: a list of ``name: {parameter: value}``.

    Raises
    ------
    ParameterError
        For an unknown effect or parameter, or a value out of range.
    """
    if not isinstance(data, list | tuple):
        raise ParameterError(("effects",), f"is {data!r}, not a list", "- exposure: {…}")
    return tuple(_read(entry, ("effects", n)) for n, entry in enumerate(data))


def register(effect: type[Effect]) -> None:
    """Add an effect to the catalogue, in place of one of the same name.

    Raises
    ------
    UsageError
        When it lacks something that every effect must declare.
    """
    CATALOGUE.register(getattr(effect, "name", effect.__name__), effect)


def load_effects(path: Path) -> list[type[Effect]]:
    """Run a Python file and register the effects that it defines.

    Raises
    ------
    UsageError
        When it can't be run, or defines none.
    """
    spec = importlib.util.spec_from_file_location(f"rsenf_effects_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise UsageError(f"{path}: not a Python file", "name one that ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look up their module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as exc:  # a user's file may raise anything
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
