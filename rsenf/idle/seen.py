"""What an idle estimator has seen of a stream so far, and what it concludes from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.idle.moments import Moments

NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Everything so far, in memory that doesn't grow.

    Parameters
    ----------
    moments : Moments
        Sums over the frames whose phase is known.
    nominal_hz, f0_hz : float
        Nominal grid frequency, and mean illumination frequency.
    frame_rate_hz : float
    """

    moments: Moments
    nominal_hz: float
    f0_hz: float
    frame_rate_hz: float

    @property
    def most_turns(self) -> float:
        """Turns down the rows of a read-out that takes all of the frame."""
        return self.f0_hz / self.frame_rate_hz

    def idle_ratio(self, turns: float) -> float:
        """Return the share of the frame that is left after so many turns."""
        return 1.0 - abs(turns) / self.most_turns


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What an estimator concludes.

    Parameters
    ----------
    verdict : str
        'estimated', 'ambiguous', 'no_signal' or 'refused'.
    reason : str
        Why nothing is claimed; empty when estimated.
    turns : float
        Of the first harmonic down the rows of one frame; negative is bottom to top.
    turns_var : float
    direction : str
        'forward', 'reverse', or '' when not told apart.
    warnings : tuple of str
    """

    verdict: str
    reason: str = ""
    turns: float = NAN
    turns_var: float = NAN
    direction: str = ""
    warnings: tuple[str, ...] = ()

    @classmethod
    def of_turns(cls, turns: float, turns_var: float, *warnings: str) -> Finding:
        """Claim a number of turns, and the direction by its sign."""
        return cls(
            verdict="estimated",
            turns=turns,
            turns_var=turns_var,
            direction="forward" if turns > 0 else "reverse",
            warnings=warnings,
        )

    @property
    def turns_std(self) -> float:
        """Standard error of the turns."""
        return float(np.sqrt(self.turns_var))
