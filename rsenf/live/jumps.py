"""Jumps of the phase: frames that were dropped or sent twice without their times telling, splices.

A phase that is out of the way of those before it is a jump only when those after it go on from
there: one second that went wrong is none. So what was to be expected without a jump is kept for
some seconds, and compared with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rsenf.live.bank import TURN_RAD
from rsenf.live.cusum import Cusum, Phase
from rsenf.timebase import seconds

AFTER_S = 3  # seconds after which is looked whether it is still out of the way
FORETOLD_S = range(1, AFTER_S + 3)
SURE_STDS = 6.0
LEAST_RAD = 0.4


@dataclass(frozen=True)
class Jump:
    """By how much the phase jumped, the limit for that, and when on the stream's clock."""

    t_ns: int
    rad: float
    limit_rad: float


class Jumps:
    """Looks for jumps in one epoch's phases."""

    def __init__(self) -> None:
        self._foretold: dict[int, tuple[float, float]] = {}  # phase and variance, by second
        self._from: Phase | None = None
        self._seen: list[Phase] = []

    def take(self, phase: Phase, evidence: Cusum) -> Jump | None:
        """Look at a phase, before the evidence takes it; return the jump that it makes sure of."""
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
    """How far a phase is out of the way and the limit, where it is beyond that."""
    mean, var = foretold
    away = phase.rad - mean
    away -= TURN_RAD * round(away / TURN_RAD)
    limit = max(SURE_STDS * math.sqrt(var + phase.var_rad2), LEAST_RAD)
    return (away, limit) if abs(away) > limit else None


def _foretold(evidence: Cusum, after_s: int) -> tuple[float, float]:
    return evidence.any_grid.phase_after(float(after_s))
