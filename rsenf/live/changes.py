"""Sudden changes of the flicker: jumps of its phase, changes of its amplitude or the idle ratio.

Frames dropped or repeated with continuous time stamps, and splices, make the phase jump. A phase
that deviates from its prediction is a jump only if the next ones deviate too: a single outlier
isn't. The predictions from before the jump are kept for some seconds for this comparison. A changed
lamp, view or camera changes the amplitude or the idle ratio.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.live.bank import TURN_RAD
from rsenf.live.cusum import Cusum, Phase
from rsenf.medians import median_of_few
from rsenf.messages import EnfEstimate, IdleEstimate
from rsenf.timebase import seconds

AFTER_S = 3  # seconds of deviation that confirm a jump
FORETOLD_S = range(1, AFTER_S + 3)
SURE_JUMP_STDS = 6.0
LEAST_RAD = 0.4


@dataclass(frozen=True)
class Jump:
    """A phase jump: time on the stream's clock, size, and the limit it exceeded."""

    t_ns: int
    rad: float
    limit_rad: float


class Jumps:
    """Detects jumps in the phases of one epoch."""

    def __init__(self) -> None:
        self._foretold: dict[int, tuple[float, float]] = {}  # predicted phase, variance; by second
        self._from: Phase | None = None
        self._seen: list[Phase] = []

    def take(self, phase: Phase, evidence: Cusum) -> Jump | None:
        """Take a phase; return the jump that it confirms, if any.

        Parameters
        ----------
        phase : Phase
        evidence : Cusum
            Predicts phases. It must take this phase after this call, not before.
        """
        last = evidence.last
        if last is None:
            return None
        if self._from is None:
            ahead_s = _after_s(last, phase)
            if ahead_s in FORETOLD_S and _is_out(phase, _foretold(evidence, ahead_s)) is not None:
                self._from, self._seen = last, [phase]
                self._foretold = {after_s: _foretold(evidence, after_s) for after_s in FORETOLD_S}
            return None
        self._seen.append(phase)
        if seconds(phase.t_ns - self._from.t_ns) < AFTER_S + 0.5:
            return None
        foretold = [self._foretold.get(_after_s(self._from, p)) for p in self._seen]
        found = [f and _is_out(p, f) for p, f in zip(self._seen, foretold, strict=True)]
        self._from = None
        last_out = found[-1]
        if last_out is None or any(out is None for out in found):
            return None
        return Jump(self._seen[0].t_ns, *last_out)


def _after_s(last: Phase, phase: Phase) -> int:
    return round(seconds(phase.t_ns - last.t_ns))


def _is_out(phase: Phase, foretold: tuple[float, float]) -> tuple[float, float] | None:
    """Return a phase's deviation from its prediction and the limit; None if below the limit."""
    mean, var = foretold
    away = phase.rad - mean
    away -= TURN_RAD * round(away / TURN_RAD)
    limit = max(SURE_JUMP_STDS * math.sqrt(var + phase.var_rad2), LEAST_RAD)
    return (away, limit) if abs(away) > limit else None


def _foretold(evidence: Cusum, after_s: int) -> tuple[float, float]:
    return evidence.any_grid.phase_after(float(after_s))


NEW_S = 8  # newest seconds, which are compared with the OLD_S before
OLD_S = 120
LEAST_S = 30  # least number of earlier seconds
SURE_CHANGE_STDS = 8.0
LEAST_LOG = math.log(1.3)  # clouds and people change the amplitude by less
MAD_TO_STD = 1.4826  # standard deviation of a normal over its median absolute deviation
# Smallest difference of two idle ratios, beside their intervals: a codec shifts them by some tenths
# of a percentage point.
LEAST_IDLE = 0.01


@dataclass(frozen=True)
class Change:
    """A changed quantity: its value, the value before, and the limit that was exceeded."""

    value: float
    before: float
    limit: float


class FlickerSize:
    """Compares the flicker's amplitude with that of the minutes before, on a log scale.

    A change is reported if all of the newest values differ from the median in the same direction,
    by more than 8 robust standard deviations (median absolute deviation) and a factor of 1.3.
    """

    def __init__(self) -> None:
        self._log: deque[float] = deque(maxlen=OLD_S + NEW_S)

    def take(self, estimate: EnfEstimate) -> Change | None:
        """Take an estimate; return the factor by which the amplitude has changed, if it has."""
        size = math.hypot(float(estimate.amplitude_re[0]), float(estimate.amplitude_im[0]))
        if size <= 0.0:
            return None
        self._log.append(math.log(size))
        if len(self._log) < LEAST_S + NEW_S:
            return None
        every = np.array(self._log)
        old, new = every[:-NEW_S], every[-NEW_S:]
        middle = float(median_of_few(old))
        scatter = MAD_TO_STD * float(median_of_few(np.abs(old - middle)))
        limit = max(SURE_CHANGE_STDS * scatter, LEAST_LOG)
        away = new - middle
        if not (np.abs(away) > limit).all() or abs(away.sum()) != np.abs(away).sum():
            return None
        return Change(math.exp(float(np.median(away))), 1.0, math.exp(limit))


class IdlePeriod:
    """Compares each idle estimate with an older one."""

    def __init__(self) -> None:
        self._known: IdleEstimate | None = None

    def take(self, estimate: IdleEstimate) -> Change | None:
        """Take an estimate; return the change, if it is incompatible with the older one."""
        if estimate.verdict != "estimated" or not math.isfinite(estimate.idle_ratio):
            return None
        known = self._known
        if known is None:
            self._known = estimate
            return None
        apart = abs(estimate.idle_ratio - known.idle_ratio)
        limit = max(_half(estimate) + _half(known), LEAST_IDLE)
        # An estimate uses the whole epoch, so after a change it moves slowly. It is therefore
        # compared with an old one, which is replaced only by a much more precise one.
        if apart > limit or _half(estimate) < _half(known) / 2.0:
            self._known = estimate
        return Change(estimate.idle_ratio, known.idle_ratio, limit) if apart > limit else None


def _half(estimate: IdleEstimate) -> float:
    """Return half the width of the 95 % interval."""
    return (estimate.idle_ratio_high - estimate.idle_ratio_low) / 2.0
