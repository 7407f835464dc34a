"""The complete description of a capture, as a versioned dictionary or model file."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rsenf.model import parameters
from rsenf.model.effects.base import Effect, SceneEffect
from rsenf.model.effects.catalogue import make_effect, read_effects
from rsenf.model.effects.light import Harmonics
from rsenf.model.light import Light
from rsenf.model.noise import Sensor
from rsenf.model.parameters import ParameterError, parse_frame_rate
from rsenf.model.scene import Scene
from rsenf.model.shutter import Shutter
from rsenf.model.video_file import Codec

VERSION = 2
_PARTS = ("light", "scene", "shutter", "sensor", "codec")


@dataclass(frozen=True, kw_only=True)
class CaptureModel:
    """Light × scene × shutter × sensor × codec, and the effects beyond a plain capture.

    ``provenance`` holds information on the model's origin, such as the data it was fitted to and
    the standard errors of its parameters; the simulation ignores it.
    """

    name: str = "default"
    light: Light = field(default_factory=Light)
    scene: Scene = field(default_factory=Scene)
    shutter: Shutter = field(default_factory=Shutter)
    sensor: Sensor = field(default_factory=Sensor)
    codec: Codec = field(default_factory=Codec)
    effects: tuple[Effect, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict, compare=False)

    def validate(self) -> None:
        """Check every parameter.

        Raises
        ------
        ParameterError
            Naming the first one that is out of its range.
        """
        for part in _PARTS:
            parameters.validate(getattr(self, part), (part,))
        self.codec.validate()
        self.scene.check(self.shutter)
        for n, effect in enumerate(self.effects):
            path = ("effects", n, effect.name)
            parameters.validate(effect, path)
            try:
                effect.check(self.shutter)
            except ParameterError as exc:
                raise exc.below(path) from exc
        if sum(isinstance(e, SceneEffect) for e in self.effects) > 1:
            raise ParameterError(("effects",), "put more than one thing in front of the wall")

    def with_effect(self, name: str, /, **values: Any) -> CaptureModel:
        """Return the model with an effect, which replaces those of its name.

        Parameters
        ----------
        name : str
            Of the catalogue.
        **values
            Its parameters; the others keep their defaults.

        Raises
        ------
        ParameterError
            For an unknown effect or parameter, or a value out of range.

        Examples
        --------
        >>> CaptureModel().with_effect("gamma", exponent=1.5).effects
        (Gamma(exponent=1.5),)
        """
        return self.without(name).plus(make_effect(name, values))

    def changed(
        self,
        *,
        size: tuple[int, int] | None = None,
        frame_rate: object = None,
        idle_ratio: float | None = None,
        lamp: str | None = None,
        clock_ppm: float | None = None,
        **codec: Any,
    ) -> CaptureModel:
        """Return the model with the given values; None keeps the model's own.

        Parameters
        ----------
        size : (int, int), optional
            Columns and rows.
        frame_rate, idle_ratio : optional
            Of the shutter.
        lamp : str, optional
        clock_ppm : float, optional
            Of an effect ``clock_skew``.
        **codec
            Parameters of the codec; a bit rate or ``lossless`` replaces both of the model's.

        Raises
        ------
        UsageError
            For a value out of range.
        """
        columns, rows = size or (None, None)
        rate = None if frame_rate is None else parse_frame_rate(frame_rate)
        shutter = {"frame_rate": rate, "rows": rows, "columns": columns, "idle_ratio": idle_ratio}
        encoding = self.codec
        if codec.get("bitrate_bps") or codec.get("lossless"):
            encoding = dataclasses.replace(encoding, bitrate_bps=None, lossless=False)
        model = dataclasses.replace(
            self,
            light=_over(self.light, {"lamp": lamp}),
            shutter=_over(self.shutter, shutter),
            codec=_over(encoding, codec),
        )
        return model if clock_ppm is None else model.with_effect("clock_skew", clock_ppm=clock_ppm)

    def without(self, name: str) -> CaptureModel:
        """Return the model without the effects of a name."""
        kept = tuple(e for e in self.effects if e.name != name)
        return dataclasses.replace(self, effects=kept)

    def put(self, effect: Effect) -> CaptureModel:
        """Return the model with an effect in the place of the one of its name, or behind all."""
        if all(e.name != effect.name for e in self.effects):
            return self.plus(effect)
        effects = tuple(effect if e.name == effect.name else e for e in self.effects)
        return dataclasses.replace(self, effects=effects)

    def plus(self, *effects: Effect) -> CaptureModel:
        """Return the model with more effects."""
        return dataclasses.replace(self, effects=self.effects + effects)

    def named_effects(self, f0_hz: float) -> list[dict[str, object]]:
        """List the effects of this capture, as its ground truth does.

        A lamp that isn't a pure tone counts as ``harmonics``. What a real encoder adds isn't known
        in advance.

        Parameters
        ----------
        f0_hz : float
            Nominal illumination frequency.
        """
        found: list[dict[str, object]] = [
            {"name": e.name, "parameters": e.to_dict()} for e in self.effects
        ]
        if not any(isinstance(e, Harmonics) for e in self.effects):
            found = [*self._lamp_harmonics(f0_hz), *found]
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain values, with the version of their schema."""
        parts = {part: parameters.to_dict(getattr(self, part)) for part in _PARTS}
        values = {"version": VERSION, "name": self.name, **parts}
        values["effects"] = [{effect.name: effect.to_dict()} for effect in self.effects]
        return values | ({"provenance": self.provenance} if self.provenance else {})

    @classmethod
    def from_dict(cls, data: Any) -> CaptureModel:
        """Read a model from plain values; missing ones keep their default.

        Raises
        ------
        ParameterError
            For another version, an unknown key, or a value out of range.
        """
        if not isinstance(data, dict):
            raise ParameterError((), f"is {data!r}, not a mapping")
        if data.get("version") != VERSION:
            raise ParameterError(
                ("version",),
                f"is {data.get('version')!r}, this program reads {VERSION}",
                f"a model file begins with 'version: {VERSION}'",
            )
        effects = read_effects(data.get("effects", ()))
        parts = {k: v for k, v in data.items() if k not in ("version", "effects")}
        model = dataclasses.replace(parameters.from_dict(cls, parts), effects=effects)
        model.validate()
        return model

    def _lamp_harmonics(self, f0_hz: float) -> list[dict[str, object]]:
        series = self.light.series(f0_hz)
        if not np.abs(series[0]) or not np.abs(series[1:]).any():
            return []
        others = np.zeros(max(series.size - 1, 2), np.complex128)
        others[: series.size - 1] = series[1:] / series[0]
        sizes, phases = np.abs(others).tolist(), np.angle(others).tolist()
        harmonics = Harmonics(
            second_ratio=sizes[0], third_ratio=sizes[1],
            second_phase_rad=phases[0], third_phase_rad=phases[1],
            higher_ratios=tuple(sizes[2:]), higher_phases_rad=tuple(phases[2:]),
        )  # fmt: skip
        return [{"name": harmonics.name, "parameters": harmonics.to_dict()}]


def _over(part: Any, given: Mapping[str, object]) -> Any:
    """Return a part of the model with the given values; None keeps the part's own."""
    return dataclasses.replace(part, **{k: v for k, v in given.items() if v is not None})
