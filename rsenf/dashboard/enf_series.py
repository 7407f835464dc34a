"""A feed's ENF: the last ten minutes in steps of 1 s, the last hour as means over 10 s."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.dashboard.plain import rounded
from rsenf.timebase import NS_PER_S

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
