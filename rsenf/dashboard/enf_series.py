"""A feed's ENF and the published grid frequencies, by time, as numbers for JSON.

A feed has the last ten minutes in steps of 1 s, and the last hour as means over 10 s.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import ReferenceBlock
from rsenf.timebase import NS_PER_S

LATEST_NS = 1 << 62  # in the year 2116


def rounded(value: float, digits: int) -> float | None:
    """Round a number; None if it isn't finite.

    Examples
    --------
    >>> rounded(50.01234, 3), rounded(float("nan"), 3)
    (50.012, None)
    """
    return round(value, digits) if math.isfinite(value) else None


def sensible(t_ns: int) -> int:
    """Return a wall-clock time; 0 (unknown) if it isn't between 1970 and LATEST_NS."""
    return t_ns if 0 < t_ns < LATEST_NS else 0


def in_ms(t_ns: int) -> int | None:
    """Convert a wall-clock time to ms; None if unknown."""
    return sensible(t_ns) // 1_000_000 or None


RECENT, HOUR = "recent", "hour"
MEAN_NS = 10 * NS_PER_S
KEPT = {RECENT: 600, HOUR: 360}
SPACE_NS = {RECENT: NS_PER_S, HOUR: MEAN_NS}
SPARKS = 60
# Returns the reference frequencies (Hz) at given times (ns); NaN where there is none.
Lookup = Callable[[NDArray[np.int64]], NDArray[np.float64]]


class Point(NamedTuple):
    """One value; NaN for no usable estimate."""

    t_ns: int
    enf_hz: float
    std_hz: float
    snr_db: float


class EnfSeries:
    """Both series. Times increase: when a clock is set back, later points are removed."""

    def __init__(self) -> None:
        self._points = {name: deque[Point](maxlen=kept) for name, kept in KEPT.items()}
        self._sum: list[Point] = []

    def add(self, point: Point) -> None:
        """Add the value of one second."""
        self._append(RECENT, point)
        if self._sum and point.t_ns // MEAN_NS != self._sum[0].t_ns // MEAN_NS:
            self._append(HOUR, _mean(self._sum))
            self._sum.clear()
        self._sum.append(point)

    def _append(self, name: str, point: Point) -> None:
        points, space_ns = self._points[name], SPACE_NS[name]
        while points and points[-1].t_ns >= point.t_ns:
            points.pop()
        if points and point.t_ns - points[-1].t_ns > 2.5 * space_ns:
            nan = float("nan")
            points.append(Point(points[-1].t_ns + space_ns, nan, nan, nan))
        points.append(point)

    @property
    def last_ns(self) -> int:
        """Time of the newest value; 0 for none."""
        return self._points[RECENT][-1].t_ns if self._points[RECENT] else 0

    def plain(self, name: str, reference: Lookup) -> dict[str, Any]:
        """Return the series 'recent' or 'hour' for JSON, by columns; times in ms."""
        points = self._points[name]
        t_ns = np.array([p.t_ns for p in points], np.int64)
        return {
            "t_ms": (t_ns // 1_000_000).tolist(),
            "enf_hz": [rounded(p.enf_hz, 6) for p in points],
            "std_hz": [rounded(p.std_hz, 6) for p in points],
            "snr_db": [rounded(p.snr_db, 1) for p in points],
            "reference_hz": [rounded(float(hz), 6) for hz in reference(t_ns)],
        }

    def sparks(self) -> list[float | None]:
        """Return the last five minutes as means over 5 s, in Hz, for a sparkline."""
        recent = list(self._points[RECENT])[-5 * SPARKS :]
        return [
            rounded(_mean(recent[i : i + 5]).enf_hz, 4) for i in range(0, len(recent) // 5 * 5, 5)
        ]


def _mean(points: list[Point]) -> Point:
    """Mean of the finite values, at the centre of all times."""
    t_ns = (points[0].t_ns + points[-1].t_ns) // 2
    known = np.array([p[1:] for p in points if np.isfinite(p.enf_hz)])
    if not known.size:
        return Point(t_ns, *[float("nan")] * 3)
    return Point(t_ns, *known.mean(axis=0).tolist())


KEPT_SAMPLES = 100_000  # of each grid: slightly more than a day at one sample a second
KEPT_GRIDS = 16


class GridReference:
    """The newest samples of one grid.

    Attributes
    ----------
    t0_ns : int
        Start of its first sample, UTC; 0 is unknown.
    """

    def __init__(self) -> None:
        self.t0_ns = 0
        self._step_ns = 0
        self._begin()

    def _begin(self) -> None:
        self._number, self._freq_hz = np.empty(0, np.int64), np.empty(0, np.float32)
        # Samples since the last merge; merging with each block would be too slow.
        self._fresh: list[tuple[NDArray[np.int64], NDArray[np.float32]]] = []
        self._fresh_samples = 0

    def add(self, block: ReferenceBlock) -> None:
        """Add a block. Another time axis discards all samples; an invalid one is ignored."""
        if not (0 < block.step_ns < LATEST_NS and 0 <= block.first < LATEST_NS // block.step_ns):
            return
        if (sensible(block.t0_ns), block.step_ns) != (self.t0_ns, self._step_ns):
            self.t0_ns, self._step_ns = sensible(block.t0_ns), block.step_ns
            self._begin()
        # Implausible frequencies count as gaps.
        freq_hz = np.where(np.abs(block.freq_hz) < 1000, block.freq_hz, np.nan).astype(np.float32)
        if not freq_hz.size:
            return
        self._fresh.append((block.first + np.arange(freq_hz.size), freq_hz))
        self._fresh_samples += freq_hz.size
        if self._fresh_samples > KEPT_SAMPLES:
            self._put_together()

    def at(self, since_start_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return frequencies in Hz at times after the first sample, in ns; NaN where unknown."""
        found = np.full(since_start_ns.shape, np.nan)
        self._put_together()
        number, freq_hz = self._number, self._freq_hz
        if not number.size:
            return found
        wanted = since_start_ns // self._step_ns
        place = np.clip(np.searchsorted(number, wanted), 0, number.size - 1)
        there = number[place] == wanted
        found[there] = freq_hz[place[there]]
        return found

    def _put_together(self) -> None:
        """Merge new samples; of duplicates the latest counts."""
        if not self._fresh:
            return
        came = [(self._number, self._freq_hz), *self._fresh][::-1]
        self._fresh, self._fresh_samples = [], 0
        number, place = np.unique(np.concatenate([n for n, _ in came]), return_index=True)
        freq_hz = np.concatenate([f for _, f in came])[place]
        self._number, self._freq_hz = number[-KEPT_SAMPLES:], freq_hz[-KEPT_SAMPLES:]


class References:
    """All grids by name."""

    def __init__(self) -> None:
        self._grids: dict[str, GridReference] = {}

    def add(self, block: ReferenceBlock) -> None:
        """Add a block to its grid."""
        if block.grid in self._grids or len(self._grids) < KEPT_GRIDS:
            self._grids.setdefault(block.grid, GridReference()).add(block)

    def by_clock(self, t_ns: int) -> tuple[str, int] | None:
        """Return a grid with a known frequency at a UTC time, and the time of its first sample."""
        for name, grid in self._grids.items():
            if grid.t0_ns and np.isfinite(grid.at(np.array([t_ns - grid.t0_ns]))[0]):
                return name, grid.t0_ns
        return None

    def at(self, name: str, t_ns: NDArray[np.int64], first_sample_ns: int) -> NDArray[np.float64]:
        """Return a grid's frequencies in Hz at times on any clock.

        Parameters
        ----------
        name : str
            Grid.
        t_ns : ndarray of int64, shape (times,)
        first_sample_ns : int
            Time of the reference's first sample on the same clock.
        """
        grid = self._grids.get(name)
        return np.full(t_ns.shape, np.nan) if grid is None else grid.at(t_ns - first_sample_ns)
