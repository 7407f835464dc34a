"""The whole capture as one description, versioned, as a dictionary or a model file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rsenf.model import parameters
from rsenf.model.codec import Codec
from rsenf.model.delivery import Delivery
from rsenf.model.light import Light
from rsenf.model.parameters import ParameterError
from rsenf.model.scene import Scene
from rsenf.model.sensor import Sensor
from rsenf.model.shutter import Shutter

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class CaptureModel:
    """Light × scene × shutter × sensor × delivery × codec."""

    name: str = "default"
    light: Light = field(default_factory=Light)
    scene: Scene = field(default_factory=Scene)
    shutter: Shutter = field(default_factory=Shutter)
    sensor: Sensor = field(default_factory=Sensor)
    delivery: Delivery = field(default_factory=Delivery)
    codec: Codec = field(default_factory=Codec)

    def validate(self) -> None:
        """Check every parameter.

        Raises
        ------
        ParameterError
            Naming the first that isn't plausible.
        """
        parameters.validate(self)
        self.shutter.validate()
        self.codec.validate()
        self.light.series()

    def effects(self) -> list[dict[str, object]]:
        """Named effects of this capture, each with its parameters, in the order light meets them.

        Names are those of the catalogue of effects; what an encoder adds is not known before.
        """
        moving = self.scene.moving.effects() if self.scene.moving else []
        return self.light.effects() + moving + self.shutter.effects() + self.delivery.effects()

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain values, with the version of their layout."""
        return {"version": VERSION, **parameters.to_dict(self)}

    @classmethod
    def from_dict(cls, data: Any) -> CaptureModel:
        """Read a model from plain values; what isn't given keeps its default.

        Raises
        ------
        ParameterError
            For another version, an unknown key, or a value that isn't plausible.
        """
        if not isinstance(data, dict):
            raise ParameterError((), f"is {data!r}, not a mapping")
        if data.get("version") != VERSION:
            raise ParameterError(
                ("version",),
                f"is {data.get('version')!r}, this program reads {VERSION}",
                f"a model file begins with 'version: {VERSION}'",
            )
        model = parameters.from_dict(cls, {k: v for k, v in data.items() if k != "version"})
        model.validate()
        return model
