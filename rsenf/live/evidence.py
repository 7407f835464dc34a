"""The running evidence for 'follows the grid now' against 'a grid's wander that is not this one'.

Each phase tells how much likelier it is by the reference than by any grid whatever; these
log-likelihood ratios are added up. The sum stops at both ends, so that a change is seen as fast
after a day as after a minute: E. S. Page, "Continuous inspection schemes", Biometrika 41, 1954.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.live.any_grid import AnyGrid
from rsenf.live.follows import Course, Follows
from rsenf.live.settings import LiveSettings
from rsenf.messages.schema import FloatArray

LONGEST_S = 60.0  # without a phase, after which the next one tells nothing
WILD, SEEN = 5, 20  # so many of the last phases out of the way are too many


@dataclass(frozen=True)
class Phase:
    """A measured phase (rad, and its variance) and its time on the stream's clock."""

    t_ns: int
    rad: float
    var_rad2: float


class Evidence:
    """Of one epoch of one camera.

    Parameters
    ----------
    settings : LiveSettings
    nominal_hz : float

    Attributes
    ----------
    nats : float
        The sum.
    last : Phase or None
    """

    def __init__(self, settings: LiveSettings, nominal_hz: float) -> None:
        self._limits = settings.limits
        self.follows, self.any_grid = Follows(settings, nominal_hz), AnyGrid()
        self.nats = 0.0
        self.last: Phase | None = None
        self._out: deque[bool] = deque(maxlen=SEEN)

    @property
    def course(self) -> Course:
        """Lag and clock that fit best."""
        return self.follows.course

    def take(self, phase: Phase, moved_rad: FloatArray | None) -> None:
        """Take a phase in, with how far the reference's went since the last; None for unknown."""
        passed_s = (phase.t_ns - self.last.t_ns) / 1e9 if self.last else 0.0
        if passed_s > LONGEST_S:
            self.any_grid.lose_phase()
            self.nats = 0.0  # what followed the grid then needn't be what is shown now
        if moved_rad is None or passed_s > LONGEST_S:
            self.follows.lose_phase()
        moved = np.zeros(self.follows.lag_s.size) if moved_rad is None else moved_rad
        by_reference = self.follows.take(passed_s, phase.rad, phase.var_rad2, moved)
        by_any = self.any_grid.take(passed_s, phase.rad, phase.var_rad2)
        if moved_rad is not None and 0.0 < passed_s <= LONGEST_S:
            self._weigh(by_reference - by_any)
        self.last = phase

    def _weigh(self, nats: float) -> None:
        """Add what a phase tells; one that no grid would have tells of none."""
        self._out.append(self.any_grid.was_out)
        if self.is_wild:
            self.nats = 0.0
        elif not self.any_grid.was_out:
            now = self.nats + nats
            self.nats = min(max(now, self._limits.least), self._limits.most)

    @property
    def is_wild(self) -> bool:
        """Whether the phases of late jump about as no grid does: then they are none."""
        return sum(self._out) > WILD
