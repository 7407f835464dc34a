"""Finds when a stale picture was taken: in the reference's past, and in the feed's own past.

A looped feed follows the grid of an earlier time, which the phase matcher finds over all lags, as
for a recording. With the feed's earlier ENF as the reference, a match means that the feed repeats.
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

LEAST_S = 40  # least number of usable seconds without a jump for a search
MOST_S = 240
APART_S = 10.0  # gap between the estimates and the part of the feed's past they are compared with


@dataclass(frozen=True)
class Origin:
    """Age of a picture, and its standard error."""

    age_s: float
    std_s: float


def in_reference(
    estimates: list[EnfEstimate], offset_ns: int, grid: Grid, youngest_s: float
) -> Origin | None:
    """Match estimates with a reference's past.

    Parameters
    ----------
    estimates : list of EnfEstimate
        Consecutive, without a jump.
    offset_ns : int
        UTC minus the stream's clock.
    grid : Grid
        The reference up to now.
    youngest_s : float
        Ages up to this count as the present.

    Returns
    -------
    Origin or None
        None without a match, or if it is in the present.
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
    except UsageError:  # the sampling steps of the two are incompatible
        return None
    return found if found.decision == "match" else None


class OwnPast:
    """The feed's own ENF, one value a second on this host's clock, as a reference."""

    def __init__(self, keep_hours: float) -> None:
        self._keep_ns = nanoseconds(3600 * keep_hours)
        self._enf: deque[tuple[int, float]] = deque(maxlen=round(3600 * keep_hours))

    def add(self, estimate: EnfEstimate, offset_ns: int) -> None:
        """Add a usable estimate."""
        self._enf.append((estimate.start_pts_ns + offset_ns, estimate.enf_hz))

    def repeated(self, estimates: list[EnfEstimate], offset_ns: int) -> Origin | None:
        """Match the newest estimates with earlier ones.

        Parameters
        ----------
        estimates : list of EnfEstimate
            Consecutive, without a jump.
        offset_ns : int
            UTC minus the stream's clock.

        Returns
        -------
        Origin or None
            Age of the earlier ones; None without a match.
        """
        until_ns = estimates[0].start_pts_ns + offset_ns - nanoseconds(APART_S)
        # The host's clock may have been set, even by years after a start without a clock.
        before = [(t, hz) for t, hz in self._enf if 0 < until_ns - t <= self._keep_ns]
        if len(before) < LEAST_S:
            return None
        first_ns = min(t for t, _ in before)
        index = np.rint([(t - first_ns) / NS_PER_S for t, _ in before]).astype(np.int64)
        freq = np.full(int(index.max()) + 1, np.nan)
        freq[index] = [hz for _, hz in before]
        grid = Grid("its own past", estimates[0].nominal_hz, first_ns, 1.0, freq)
        return in_reference(estimates, offset_ns, grid, APART_S)
