"""Detects phase jumps: frames dropped or repeated with continuous time stamps, or splices.

A phase that deviates from its prediction is a jump only if the next ones deviate too: a single
outlier isn't. The predictions from before the jump are kept for some seconds for this comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rsenf.live.bank import TURN_RAD
from rsenf.live.cusum import Cusum, Phase
from rsenf.timebase import seconds

AFTER_S = 3  # seconds of deviation that confirm a jump
FORETOLD_S = range(1, AFTER_S + 3)
SURE_STDS = 6.0
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
    limit = max(SURE_STDS * math.sqrt(var + phase.var_rad2), LEAST_RAD)
    return (away, limit) if abs(away) > limit else None


def _foretold(evidence: Cusum, after_s: int) -> tuple[float, float]:
    return evidence.any_grid.phase_after(float(after_s))
