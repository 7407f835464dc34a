"""What an effect is: parameters, and an ``apply`` at one place of the capture.

The places, in the order that light and frames pass them. What an effect is given there, it changes
in place, or returns anew where a type to return is written::

    FrameEffect      Clip       when each frame begins, and how fast the camera's clock is
    ReadOutEffect    ReadOut    when each line of a block of frames is exposed, how long, and where
                                the picture stands
    WaveformEffect   series     the lamp's Fourier series                        -> series
    LightEffect      LineLight  the light on each line of a block of frames
    SceneEffect      wall       the picture under the mean light                 -> Patch
    SensorEffect     LineLight  what the sensor makes of the light
    ToneEffect       exponent   the power law by which levels leave the camera   -> exponent
    DeliveryEffect   Clip       which frames arrive, and what their stamps say
    CodecEffect      LineLight  what an encoder leaves of the light, in delivered frames

An effect is a frozen dataclass whose fields are made by :func:`rsenf.model.parameters.parameter`:
default, one line of text, plausible range, and the unit in the name. Its docstring says in one
paragraph what it does to the data. ``configs/model/my_effect.py`` is a template for one's own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rsenf.model import parameters
from rsenf.model.clip import Clip
from rsenf.model.effects.hiding import Hiding, Weakest
from rsenf.model.effects.residue import Residue
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import ParameterError
from rsenf.model.readout import ReadOut
from rsenf.model.scene import Float32Array
from rsenf.model.seeds import generator
from rsenf.model.shutter import Shutter
from rsenf.model.view import Patch


@dataclass(frozen=True, eq=False)
class Run:
    """One effect in one simulated clip: what it may know, its random numbers and its memory.

    Attributes
    ----------
    label : str
        Name of the effect, and which of its kind it is.
    shutter : Shutter
        The plain shutter, before any effect.
    frames : int
        Frames that are captured.
    mean_level : float
        8-bit level of the scene under the mean light.
    seed : int
        Seed of the simulation.
    memory : dict
        Whatever the effect keeps from one block to the next.
    """

    label: str
    shutter: Shutter
    frames: int
    mean_level: float
    seed: int
    memory: dict[str, Any] = field(default_factory=dict)

    @property
    def step_s(self) -> float:
        """Frame period."""
        return 1 / float(self.shutter.frame_rate)

    def rng(self, block: int = 0) -> np.random.Generator:
        """Return the effect's own random numbers, for a block or for the whole clip."""
        return generator(self.seed, f"effect {self.label}", block)

    def kept(self, make: Callable[[np.random.Generator], FloatArray]) -> FloatArray:
        """Draw a series for the whole clip once, and return it from then on."""
        if "series" not in self.memory:
            self.memory["series"] = make(self.rng())
        return np.asarray(self.memory["series"])

    def given(self, series: tuple[float, ...], count: int | None = None) -> FloatArray:
        """Return a series that a model gives, one value a frame unless there is another count.

        Raises
        ------
        ParameterError
            When there aren't as many.
        """
        wanted = self.frames if count is None else count
        if len(series) < wanted:
            problem = f"has a series of {len(series)}, for {wanted}"
            raise ParameterError(("effects", self.label.split()[0]), problem)
        return np.array(series[:wanted])


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Something that a plain capture doesn't do.

    Attributes
    ----------
    name : str
        By which model files and results call it.
    source : str
        Where it is described, or what it is known from.
    confused_with : tuple of str
        Effects (or fitted parameters) whose data can look the same.
    told_apart_by : str
        Which data or further measurement decides between them.
    along_lines : bool
        Whether its light changes from one end of a line to the other.
    weakest : Weakest or None
        The weakest of it that is to be named; None for one that a blind test can't hide.
    not_hidden : str
        Why it can't.
    never_with : tuple of str
        Effects that can't be had at the same time, or that the data can't tell from it.
    masks : tuple of str
        Effects that aren't looked for beside it: where it is known but nearly, it looks like them.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]]
    told_apart_by: ClassVar[str]
    along_lines: ClassVar[bool] = False
    weakest: ClassVar[Weakest | None] = None
    not_hidden: ClassVar[str] = "it doesn't say how weak it may be"
    never_with: ClassVar[tuple[str, ...]] = ()
    masks: ClassVar[tuple[str, ...]] = ()

    @property
    def same_as(self) -> tuple[str, ...]:
        """Names of effects that, with parameters such as these, do the same to all data."""
        return ()

    def check(self, shutter: Shutter) -> None:  # noqa: B027 # most effects fit every shutter
        """Check what no single range can.

        Raises
        ------
        ParameterError
            With a path from the effect down.
        """

    def to_dict(self) -> dict[str, Any]:
        """Return its parameters as plain values."""
        return parameters.to_dict(self)

    @classmethod
    def guesses(cls, residue: Residue) -> list[dict[str, Any]]:
        """Guess values from which a search for it may begin; none where there is no sign of it.

        Parameters
        ----------
        residue : Residue
            What a model without it leaves.

        Returns
        -------
        list of dict
            Parameters each, of those that aren't fitted from neutral. By default one guess, the
            defaults, if there is a parameter to be fitted at all.
        """
        return [{}] if parameters.fittings(cls) else []

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw parameters with which it is hidden in a clip.

        By default its size alone, so many times as far from neutral as the weakest.
        """
        weakest = cls.weakest
        if weakest is None or not weakest.size:
            return {}
        return {weakest.size: weakest.neutral + hiding.times * weakest.change}


class FrameEffect(Effect):
    """Acts on when frames begin, or on the camera's clock."""

    @abstractmethod
    def apply(self, clip: Clip, run: Run) -> None:
        """Change ``clip.start_s``, ``clip.stamp_offset_s`` or ``clip.clock_factor``."""


class ReadOutEffect(Effect):
    """Acts on when, how long and where lines are exposed."""

    @abstractmethod
    def apply(self, read_out: ReadOut, run: Run) -> None:
        """Change any of the read-out's arrays or times."""


class WaveformEffect(Effect):
    """Acts on the waveform of the lamp."""

    @abstractmethod
    def apply(self, series: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return other complex amplitudes (harmonics,), relative to the mean light."""


class LightEffect(Effect):
    """Acts on the light that reaches the scene."""

    @abstractmethod
    def apply(self, light: LineLight, run: Run) -> None:
        """Change ``light.level`` or ``light.slope``."""


class SceneEffect(Effect):
    """Puts something in front of the wall; a capture has room for one of these."""

    @abstractmethod
    def apply(self, wall: Float32Array, run: Run) -> Patch:
        """Return what to put in front of it, as levels under the mean light."""


class SensorEffect(Effect):
    """Acts on what the sensor makes of the light."""

    @abstractmethod
    def apply(self, light: LineLight, run: Run) -> None:
        """Change the light by a gain, or ``light.offset``."""


class ToneEffect(Effect):
    """Acts on the curve from light to level."""

    @abstractmethod
    def apply(self, exponent: float) -> float:
        """Return another exponent of ``level = 255 · (light / 255)^exponent``."""


class DeliveryEffect(Effect):
    """Acts on which frames arrive, and when their stamps say."""

    @abstractmethod
    def apply(self, clip: Clip, run: Run) -> None:
        """Change which frames ``clip`` delivers, their slots, stamps, or their rate."""


class CodecEffect(Effect):
    """Acts as an encoder would on the flicker of the delivered frames, without one."""

    @abstractmethod
    def apply(self, light: LineLight, run: Run) -> None:
        """Change ``light.level`` and ``light.slope``; frames come in order, block by block."""
