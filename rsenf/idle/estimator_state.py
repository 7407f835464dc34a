"""What an idle method is given, its settings and the state of a stream, and what it concludes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rsenf.errors import UsageError
from rsenf.flicker.lines import alias_hz, mirror_hz
from rsenf.idle.moments import Moments, StillRows


@dataclass(frozen=True)
class IdleSettings:
    """Settings of all idle methods.

    Parameters
    ----------
    method : str
        Name of the estimator.
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    every_s : float
        Stream time between estimates; the last one comes at the end. In a long stream each waits
        until the stream is an eighth longer, twenty seconds at most.
    """

    # For the validation of configuration files: a misspelt key is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    method: str = "coherent"
    nominal_hz: float | None = None
    every_s: float = 10.0

    def __post_init__(self) -> None:
        if self.nominal_hz not in (None, 50.0, 60.0):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz: 50 or 60")
        if not self.every_s > 0:
            raise UsageError(f"an estimate every {self.every_s} s")


NAN = float("nan")
NORMAL_STDS = 1.959964  # half-width of the 95 % interval of a normal law
FREEDOM = 11.0  # default degrees of freedom of a variance: from a dozen parts
# Fewest frames in the sums.
MIN_FRAMES = 60
# With an alias nearer to 0 Hz the flicker is static from frame to frame, and the grid's deviation
# alone separates it from the texture.
STILL_HZ = 1.0
ASSUMED = "top to bottom is assumed: the direction of read-out can't be told at this frame rate"


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatorState:
    """What is known of a stream so far, in bounded memory.

    Parameters
    ----------
    moments : Moments
        Sums over the frames at which the flicker's phase is known.
    segments : sequence of Moments
        The same, of one segment of the stream after another.
    still_rows : StillRows
        Rows averaged over short times, whether or not any flicker was found in them.
    nominal_hz : float
        Nominal grid frequency: the tracked one, or one with its alias at 0 Hz; NaN for neither.
    f0_hz : float
        Mean illumination frequency over the tracked time.
    frame_rate_hz : float
    unfiltered : bool
        Whether any of the rows were decoded without the codec's loop filter.
    apart_turns : float
        Rms deviation of the light's phase from one ramp that all strips share.
    """

    moments: Moments
    still_rows: StillRows
    nominal_hz: float
    f0_hz: float
    frame_rate_hz: float
    unfiltered: bool
    apart_turns: float = 0.0
    segments: Sequence[Moments] = ()

    @property
    def stands_still(self) -> bool:
        """Whether the flicker's alias is at 0 Hz."""
        return abs(alias_hz(2.0 * self.nominal_hz, self.frame_rate_hz)) < STILL_HZ

    @property
    def mirror_hz(self) -> float:
        """Frequency about which both senses of rotation look the same; NaN where they don't."""
        return mirror_hz(self.nominal_hz, self.frame_rate_hz)

    @property
    def followed(self) -> bool:
        """Whether the flicker was tracked for long enough."""
        return self.moments.frames >= MIN_FRAMES

    @property
    def most_turns(self) -> float:
        """Turns down the rows for a read-out over the whole frame period."""
        return self.f0_hz / self.frame_rate_hz


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Conclusion of an idle method.

    Parameters
    ----------
    verdict : str
        'estimated', 'ambiguous', 'no_signal' or 'refused'.
    reason : str
        Why nothing is estimated; empty when it is.
    turns : float
        Turns of the first harmonic down the rows of one frame; negative is bottom to top.
    turns_var : float
    freedom : float
        Degrees of freedom of the variance (Student's t), if it is from the data's own scatter.
    f0_hz : float
        Mean illumination frequency that the turns are of.
    direction : str
        'forward', 'reverse', or '' if unknown.
    warnings : tuple of str
    """

    verdict: str
    reason: str = ""
    turns: float = NAN
    turns_var: float = NAN
    freedom: float = FREEDOM
    f0_hz: float = NAN
    direction: str = ""
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_turns(
        cls, turns: float, turns_var: float, f0_hz: float, freedom: float = FREEDOM
    ) -> Finding:
        """Report a number of turns, with the direction by its sign."""
        return cls(
            verdict="estimated",
            turns=turns,
            turns_var=turns_var,
            freedom=freedom,
            f0_hz=f0_hz,
            direction="forward" if turns > 0 else "reverse",
        )

    def undirected(self, mirror_hz: float) -> Finding:
        """Return the finding without its direction, since the mirror image fits as well.

        Parameters
        ----------
        mirror_hz : float
            Illumination frequency about which the true one may be on either side.
        """
        turns = abs(self.turns)
        either_var = (turns * (self.f0_hz - mirror_hz) / mirror_hz) ** 2
        return dataclasses.replace(
            self,
            turns=turns,
            turns_var=self.turns_var + either_var,
            f0_hz=mirror_hz,
            direction="",
            warnings=(*self.warnings, ASSUMED),
        )

    @property
    def read_out_s(self) -> float:
        """Read-out time: from the first row to the last and one more."""
        return abs(self.turns) / self.f0_hz

    @property
    def read_out_std_s(self) -> float:
        """Its standard error."""
        return float(np.sqrt(self.turns_var)) / self.f0_hz

    @property
    def interval_stds(self) -> float:
        """Half-width of the 95 % interval in standard errors, of Student's t.

        By its expansion (Abramowitz & Stegun 26.7.5), to 0.2 % from five degrees of freedom on.

        >>> round(Finding(verdict="estimated", freedom=10.0).interval_stds, 2)
        2.23
        """
        z, n = NORMAL_STDS, self.freedom
        second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
        third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
        return z + (z**3 + z) / (4.0 * n) + second / n**2 + third / n**3
