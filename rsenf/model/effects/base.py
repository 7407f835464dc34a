"""Interface of effects: parameters, and an ``apply`` at one place of the capture.

The places, in the order that light and frames pass them. An effect changes its argument in place,
or returns a new one if the table has a type to return::

    FrameEffect      Clip       when each frame begins, and how fast the camera's clock is
    ReadOutEffect    ReadOut    when each line of a block of frames is exposed, how long, and how
                                far the picture is displaced
    WaveformEffect   series     the lamp's Fourier series                        -> series
    LightEffect      LineLight  the light on each line of a block of frames
    SceneEffect      wall       the picture under the mean light                 -> Patch
    SensorEffect     LineLight  the sensor's response to the light
    ToneEffect       exponent   the power law by which levels leave the camera   -> exponent
    DeliveryEffect   Clip       which frames are delivered, and their time stamps
    CodecEffect      LineLight  the light after an encoder, in delivered frames

An effect is a frozen dataclass whose fields are made by :func:`rsenf.model.parameters.parameter`:
default, one line of text, range, and the unit in the name. One paragraph of its docstring describes
its effect on the data. ``configs/model/my_effect.py`` is a template.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rsenf.model import parameters
from rsenf.model.effects.search import Hiding, ResidualFeatures, Weakest
from rsenf.model.grid import FloatArray
from rsenf.model.line_light import LineLight
from rsenf.model.noise import Float32Array, generator, wander
from rsenf.model.parameters import ParameterError
from rsenf.model.scene import Patch
from rsenf.model.shutter import Clip, ReadOut, Shutter


@dataclass(frozen=True, eq=False)
class Run:
    """One effect in one simulated clip: its inputs, random numbers and state.

    Attributes
    ----------
    label : str
        Name of the effect, and its number among those of that name.
    shutter : Shutter
        The plain shutter, before any effect.
    frames : int
        Captured frames.
    mean_level : float
        8-bit level of the scene under the mean light.
    seed : int
        Seed of the simulation.
    memory : dict
        State of the effect from block to block.
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

    def rng(self) -> np.random.Generator:
        """Return the effect's own random numbers, the same at each call."""
        return generator(self.seed, f"effect {self.label}")

    def kept(self, make: Callable[[np.random.Generator], FloatArray]) -> FloatArray:
        """Return a series for the whole clip, which ``make`` draws at the first call."""
        if "series" not in self.memory:
            self.memory["series"] = make(self.rng())
        return np.asarray(self.memory["series"])

    def given(self, series: tuple[float, ...], count: int | None = None) -> FloatArray:
        """Return a series that a model gives.

        Parameters
        ----------
        series : tuple of float
        count : int, optional
            Number of values needed; by default one for each frame.

        Raises
        ------
        ParameterError
            When there are fewer.
        """
        wanted = self.frames if count is None else count
        if len(series) < wanted:
            problem = f"has a series of {len(series)}, for {wanted}"
            raise ParameterError(("effects", self.label.split()[0]), problem)
        return np.array(series[:wanted])

    def wandering(
        self, series: tuple[float, ...], rms: float, time_constant_s: float
    ) -> FloatArray:
        """Return a value for each frame, as a model gives them, else wandering at random."""
        return self.kept(
            lambda rng: (
                self.given(series)
                if series
                else rms * wander(rng, self.frames, self.step_s, time_constant_s)
            )
        )


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Something that a plain capture doesn't do.

    Attributes
    ----------
    name : str
        Name in model files and results.
    source : str
        Where it is described or known from.
    confused_with : tuple of str
        Effects (or fitted parameters) whose data can look the same.
    told_apart_by : str
        Data or further measurement that separates them.
    along_lines : bool
        Whether its light varies along a line.
    weakest : Weakest or None
        Least strength that a search must find; None if a blind test can't hide it.
    not_hidden : str
        Why it can't.
    never_with : tuple of str
        Effects that exclude it, or that the data can't separate from it.
    any_course : bool
        Whether it takes on nearly any course over time without a free series: a tone, a free shape
        that comes again.
    masks : tuple of str
        Effects that aren't searched for beside it, since an error of its parameters resembles them.
    of_camera : bool
        Whether it is a lasting property of a camera in a mode, whatever is filmed.
    """

    name: ClassVar[str]
    source: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]]
    told_apart_by: ClassVar[str]
    along_lines: ClassVar[bool] = False
    weakest: ClassVar[Weakest | None] = None
    not_hidden: ClassVar[str] = "it doesn't say how weak it may be"
    never_with: ClassVar[tuple[str, ...]] = ()
    any_course: ClassVar[bool] = False
    masks: ClassVar[tuple[str, ...]] = ()
    of_camera: ClassVar[bool] = False

    @property
    def same_as(self) -> tuple[str, ...]:
        """Names of effects that, with the present parameters, are identical in all data."""
        return ()

    def check(self, shutter: Shutter) -> None:  # noqa: B027 # most effects fit every shutter
        """Check its parameters against the shutter.

        Raises
        ------
        ParameterError
            With the path within the effect.
        """

    def to_dict(self) -> dict[str, Any]:
        """Return its parameters as plain values."""
        return parameters.to_dict(self)

    @classmethod
    def guesses(cls, features: ResidualFeatures) -> list[dict[str, Any]]:
        """Initial values for a search; none if there is no sign of the effect.

        Parameters
        ----------
        features : ResidualFeatures
            Residual of a model without it.

        Returns
        -------
        list of dict
            Parameters, for each guess, that aren't fitted from neutral. By default one guess, the
            defaults, if any parameter can be fitted.
        """
        return [{}] if parameters.fittings(cls) else []

    @classmethod
    def hidden(cls, hiding: Hiding) -> dict[str, Any]:
        """Draw parameters for a blind test.

        By default only the size, at ``hiding.times`` the weakest one's distance from neutral.
        """
        weakest = cls.weakest
        if weakest is None or not weakest.size:
            return {}
        return {weakest.size: weakest.neutral + hiding.times * weakest.change}


class FrameEffect(Effect):
    """Acts on the start of frames, or on the camera's clock."""

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
    """Puts something in front of the wall; a capture can have one of these."""

    @abstractmethod
    def apply(self, wall: Float32Array, run: Run) -> Patch:
        """Return what to put in front of it, in levels under the mean light."""


class SensorEffect(Effect):
    """Acts on the sensor's response to the light."""

    @abstractmethod
    def apply(self, light: LineLight, run: Run) -> None:
        """Change the light by a gain, or ``light.offset``."""


class ToneEffect(Effect):
    """Acts on the curve from light to level."""

    @abstractmethod
    def apply(self, exponent: float) -> float:
        """Return another exponent of ``level = 255 · (light / 255)^exponent``."""


class DeliveryEffect(Effect):
    """Acts on which frames are delivered, and on their time stamps."""

    @abstractmethod
    def apply(self, clip: Clip, run: Run) -> None:
        """Change the frames that ``clip`` delivers, their slots, time stamps or rate."""


class CodecEffect(Effect):
    """Imitates the effect of an encoder on the flicker of the delivered frames."""

    @abstractmethod
    def apply(self, light: LineLight, run: Run) -> None:
        """Change ``light.level`` and ``light.slope``; frames come in order, block by block."""
