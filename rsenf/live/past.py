"""When was a stale picture taken? Looked up in the reference's past, and in the feed's own.

A looped feed follows the grid of some time ago. That time is found as a recording's is: by the
phase matcher, over all lags. The feed's own ENF of before is a reference like any other: found
there, the feed repeats itself.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.errors import UsageError
from rsenf.match.matcher import Finding
from rsenf.match.phase import match_phase
from rsenf.match.series import Grid, track_of
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate
from rsenf.timebase import NS_PER_S, nanoseconds

LEAST_S = 40  # usable seconds without a jump, below which no time is sought
MOST_S = 240
APART_S = 10.0  # between what is compared with the feed's own past and that past


@dataclass(frozen=True)
class Origin:
    """How old the picture was at the time of the search, and the standard error."""

    age_s: float
    std_s: float


def in_reference(
    estimates: list[EnfEstimate], offset_ns: int, grid: Grid, youngest_s: float
) -> Origin | None:
    """Look estimates up in a reference's past.

    Parameters
    ----------
    estimates : list of EnfEstimate
        In a row, without a jump.
    offset_ns : int
        UTC less their stream's clock.
    grid : Grid
        Up to now.
    youngest_s : float
        Ages below this are the present, not the past.
    """
    start_ns = estimates[0].origin_pts_ns + offset_ns
    found = _match(estimates, grid)
    if found is None:
        return None
    age_s = (start_ns - grid.t0_ns) / NS_PER_S - found.lag_s
    return Origin(age_s, found.lag_std_s) if age_s > youngest_s else None


def _match(estimates: list[EnfEstimate], grid: Grid) -> Finding | None:
    track = track_of(estimates)
    if track.usable < LEAST_S or grid.freq_hz.size < track.enf_hz.size:
        return None
    try:
        found = match_phase(track, [grid], MatchSettings())
    except UsageError:  # the steps of the two don't fit each other: no time can be found
        return None
    return found if found.decision == "match" else None


class OwnPast:
    """The feed's own ENF, second by second of this host's clock, as a reference."""

    def __init__(self, keep_hours: float) -> None:
        self._keep_ns = nanoseconds(3600 * keep_hours)
        self._enf: deque[tuple[int, float]] = deque(maxlen=round(3600 * keep_hours))

    def add(self, estimate: EnfEstimate, offset_ns: int) -> None:
        """Take a usable estimate in."""
        self._enf.append((estimate.start_pts_ns + offset_ns, estimate.enf_hz))

    def repeated(self, estimates: list[EnfEstimate], offset_ns: int) -> Origin | None:
        """Look for the newest estimates among those before them; return how long ago they were."""
        until_ns = estimates[0].start_pts_ns + offset_ns - nanoseconds(APART_S)
        # By a clock that may have been set: by years, where a host began without one.
        before = [(t, hz) for t, hz in self._enf if 0 < until_ns - t <= self._keep_ns]
        if len(before) < LEAST_S:
            return None
        first_ns = min(t for t, _ in before)
        index = np.rint([(t - first_ns) / NS_PER_S for t, _ in before]).astype(np.int64)
        freq = np.full(int(index.max()) + 1, np.nan)
        freq[index] = [hz for _, hz in before]
        grid = Grid("its own past", estimates[0].nominal_hz, first_ns, 1.0, freq)
        return in_reference(estimates, offset_ns, grid, APART_S)
