"""The past of the reference and of the feed: kept, and searched for the origin of a stale picture.

The reference is still being measured while it is kept. A looped feed follows the grid of an earlier
time, which the phase matcher finds over all lags, as for a recording. With the feed's earlier ENF
as the reference, a match means that the feed repeats.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.match.clip_phase import clip_phase
from rsenf.match.forecast import forecast
from rsenf.match.matcher import Finding
from rsenf.match.phase import match_phase
from rsenf.match.series import Grid, track_of
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, ReferenceBlock
from rsenf.messages.schema import FloatArray
from rsenf.timebase import NS_PER_S, nanoseconds, seconds

BESIDE_SAMPLES = 2  # samples needed after an instant, for the slope at it
GROWTH = 4096  # samples by which the array grows
LEAST_STEP_NS = 10_000_000
MOST_WAITING = 20_000  # pending blocks of later times
PLAUSIBLE_HZ = 5.0  # largest deviation from the nominal frequency


class GrowingGrid:
    """The reference up to now.

    Blocks stay pending until their time comes: a file sends years at once, and a wrong time in one
    block must not exhaust the memory. Samples older than ``keep_hours`` are dropped.

    Parameters
    ----------
    keep_hours : float
    """

    def __init__(self, keep_hours: float) -> None:
        self._keep_s = 3600.0 * keep_hours
        self._like: ReferenceBlock | None = None
        self._begin(0)

    def _begin(self, first: int) -> None:
        self._freq_hz: FloatArray = np.empty(0)
        self._first = self._end = first  # numbers of the samples held

    def add(self, block: ReferenceBlock) -> None:
        """Take a block; a repeated one overwrites itself."""
        if not block.samples or not block.t0_ns or block.step_ns < LEAST_STEP_NS:
            return
        if block.nominal_hz not in (50.0, 60.0):
            return
        if self._like is None or _axis(self._like) != _axis(block):
            self._like = block
            self._waiting: deque[ReferenceBlock] = deque(maxlen=MOST_WAITING)
            self._told_end = self._total = 0
            self._begin(block.first)
        self._total = max(self._total, block.total)
        self._told_end = max(self._told_end, block.first + block.samples)
        self._waiting.append(block)

    def reach(self, utc_ns: int) -> None:
        """Merge the pending blocks of the hours before a time, and slightly beyond it."""
        if self._like is None:
            return
        # A camera with a wrong time must not cause all samples to be dropped.
        now = min(int(self._at_s(utc_ns)), self._told_end)
        oldest = now - int(self._keep_s / self.step_s)
        later = []
        for block in self._waiting:
            if block.first > now + GROWTH:
                later.append(block)
            elif block.first + block.samples > oldest:
                self._hold(block)
        self._waiting.clear()
        self._waiting.extend(later)
        if oldest - self._first > GROWTH:
            self._freq_hz = self._freq_hz[oldest - self._first :].copy()
            self._first = oldest
            self._end = max(self._end, oldest)

    def _hold(self, block: ReferenceBlock) -> None:
        end = block.first + block.samples
        far = self._keep_s / self.step_s
        if self._first == self._end or not -far < block.first - self._end < far:
            self._begin(block.first)
        before = max(self._first - block.first, 0)
        after = end - self._first - self._freq_hz.size
        if before or after > 0:
            more = GROWTH + after if after > 0 else 0
            self._freq_hz = np.pad(self._freq_hz, (before, more), constant_values=np.nan)
        self._first -= before
        is_one = np.abs(block.freq_hz - block.nominal_hz) < PLAUSIBLE_HZ
        there = slice(block.first - self._first, end - self._first)
        self._freq_hz[there] = np.where(is_one, block.freq_hz, np.nan)
        self._end = max(self._end, end)

    @property
    def is_there(self) -> bool:
        """Whether there is a reference with known time."""
        return self._like is not None

    @property
    def is_whole(self) -> bool:
        """Whether the reference is complete."""
        return self.is_there and 0 < self._total <= self._told_end

    @property
    def nominal_hz(self) -> float:
        """50 or 60; NaN before the first block."""
        return self._like.nominal_hz if self._like else math.nan

    @property
    def step_s(self) -> float:
        """Time between samples."""
        assert self._like is not None
        return seconds(self._like.step_ns)

    @property
    def name(self) -> str:
        """Name of the grid; empty before the first block."""
        return self._like.grid if self._like else ""

    def end_ns(self) -> int:
        """Return the end of the last sample, UTC in ns; 0 before the first block."""
        return self._like.t0_ns + self._told_end * self._like.step_ns if self._like else 0

    def covers(self, utc_ns: int) -> bool:
        """Whether everything that the reference will have about a time has arrived."""
        beside_ns = nanoseconds(BESIDE_SAMPLES * self.step_s) if self._like else 0
        return self.is_there and (self.is_whole or self.end_ns() >= utc_ns + beside_ns)

    def moved(self, from_ns: int, passed_s: float, lag_s: FloatArray) -> FloatArray | None:
        """Return the change of the reference's phase over an interval, for each lag.

        Parameters
        ----------
        from_ns : int
            Start of the interval, UTC, at lag 0.
        passed_s : float
            Its length.
        lag_s : ndarray, shape (lags,)

        Returns
        -------
        ndarray, shape (lags,), or None
            Phase of the illumination relative to its nominal frequency, rad; None at a gap.
        """
        if self._like is None:
            return None
        at_s = (self._at_s(from_ns) - self._first) * self.step_s - lag_s
        phase, known = forecast(self.held(), at_s, np.array([0.0, passed_s]))
        return phase[1] - phase[0] if known[1].all() else None

    def held(self, until_ns: int | None = None) -> Grid:
        """Return the samples held as one series, up to a time (UTC, ns) if given."""
        assert self._like is not None
        stop = self._end - self._first
        if until_ns is not None:
            stop = int(np.clip(math.floor(self._at_s(until_ns)) - self._first, 0, stop))
        t0_ns = self._like.t0_ns + self._first * self._like.step_ns
        freq_hz = self._freq_hz[:stop]
        return Grid(self._like.grid, self._like.nominal_hz, t0_ns, self.step_s, freq_hz)

    def _at_s(self, utc_ns: int) -> float:
        """Convert a time to a number of samples after the reference's first."""
        assert self._like is not None
        return (utc_ns - self._like.t0_ns) / self._like.step_ns


def _axis(block: ReferenceBlock) -> tuple[object, ...]:
    """Time axis of a block; it changes if its sender was restarted."""
    return block.t0_ns, block.step_ns, block.grid, block.nominal_hz


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
    if clip_phase(track) is None or track.usable < LEAST_S or grid.freq_hz.size < track.enf_hz.size:
        return None
    try:
        found = match_phase(track, [grid], MatchSettings())
    except UsageError:  # the sampling steps of the two are incompatible
        return None
    return found if found.decision == "match" else None


class RecentValues:
    """The latest values with their times, in arrays that don't grow.

    Parameters
    ----------
    most : int
        Number of values kept.
    dtype : type
        Of the values.
    """

    def __init__(self, most: int, dtype: type[np.generic]) -> None:
        self._t_ns, self._value = np.zeros(most, np.int64), np.zeros(most, dtype)
        self._taken = 0

    def add(self, t_ns: int, value: float) -> None:
        """Add a value, in place of the oldest."""
        place = self._taken % self._t_ns.size
        self._t_ns[place], self._value[place] = t_ns, value
        self._taken += 1

    @property
    def held(self) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Times (ns) and values, both of shape (values,), in no order."""
        return self._t_ns[: self._taken], self._value[: self._taken]


class OwnPast:
    """The feed's own ENF, one value a second on this host's clock, as a reference."""

    def __init__(self, keep_hours: float) -> None:
        self._keep_ns = nanoseconds(3600 * keep_hours)
        self._enf = RecentValues(math.ceil(3600 * keep_hours), np.float64)

    def add(self, estimate: EnfEstimate, offset_ns: int) -> None:
        """Add a usable estimate."""
        self._enf.add(estimate.start_pts_ns + offset_ns, estimate.enf_hz)

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
        t_ns, enf_hz = self._enf.held
        # The host's clock may have been set, even by years after a start without a clock.
        is_before = (t_ns < until_ns) & (t_ns >= until_ns - self._keep_ns)
        if np.count_nonzero(is_before) < LEAST_S:
            return None
        first_ns = int(t_ns[is_before].min())
        index = np.rint((t_ns[is_before] - first_ns) / NS_PER_S).astype(np.int64)
        freq = np.full(int(index.max()) + 1, np.nan)
        freq[index] = enf_hz[is_before]
        grid = Grid("its own past", estimates[0].nominal_hz, first_ns, 1.0, freq)
        return in_reference(estimates, offset_ns, grid, APART_S)
