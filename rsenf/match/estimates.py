"""Keeps a clip's estimates as compact rows; a day of messages would take hundreds of megabytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import EnfEstimate, Header

# One estimate; ``said`` is an index into the pairs of method and reason seen so far.
ROW = np.dtype(
    [
        *((name, np.int64) for name in ("start_ns", "end_ns", "origin_ns")),
        *((name, np.float64) for name in ("t_s", "enf_hz", "var_hz2", "nominal_hz", "mirror_hz")),
        *((name, np.float64) for name in ("phase_rad", "phase_var_rad2")),
        ("usable", np.bool_),
        ("is_reverse", np.bool_),
        ("said", np.int32),
        *((name, np.int64) for name in ("frame_first", "frame_last")),
        *((name, np.int64) for name in ("pts_ns", "camera_time_ns", "arrival_time_ns")),
    ]
)
Rows = NDArray[np.void]


class EstimateStore:
    """Keeps a clip's estimates.

    Attributes
    ----------
    rows : ndarray of :data:`ROW`, shape (n,)
        A view, valid until the next estimate is added or forgotten.
    """

    def __init__(self) -> None:
        self._room, self._size = np.empty(256, ROW), 0
        self._said: dict[tuple[str, str], int] = {}
        self._header = Header()

    @property
    def rows(self) -> Rows:
        """All kept estimates, in order of arrival."""
        return self._room[: self._size]

    def add(self, estimate: EnfEstimate) -> None:
        """Keep an estimate."""
        if self._size == self._room.size:
            self._room = np.concatenate([self._room, np.empty_like(self._room)])
        if not self._size:
            self._header = estimate.header
        said = self._said.setdefault((estimate.method, estimate.reason), len(self._said))
        self._room[self._size] = _row(estimate, said)
        self._size += 1

    def forget(self, count: int) -> None:
        """Drop the first ``count`` estimates."""
        self._room, self._size = self.rows[count:].copy(), self._size - count

    def header(self, rows: Rows, seq: int) -> Header:
        """Return the header of a result that is based on these rows and covers their frames."""
        if not rows.size:
            return Header(seq=seq)
        first, last = rows[0], rows[-1]
        return replace(
            self._header.numbered(seq),
            frame_first=int(first["frame_first"]),
            frame_last=int(last["frame_last"]),
            pts_ns=int(first["pts_ns"]),
            camera_time_ns=int(first["camera_time_ns"]),
            arrival_time_ns=int(last["arrival_time_ns"]),
        )

    def said(self, row: Any) -> tuple[str, str]:
        """Return an estimate's method, and the reason why it isn't usable (empty if it is)."""
        return list(self._said)[int(row["said"])]

    def usual_reason(self, rows: Rows) -> str:
        """Return the most frequent reason of some rows."""
        reasons = [reason for _, reason in self._said]
        count: Counter[str] = Counter(reasons[n] for n in rows["said"].tolist())
        return count.most_common(1)[0][0]


def rows_of(estimates: Iterable[EnfEstimate]) -> Rows:
    """Return estimates as rows, the form that tracks are made from."""
    return np.array([_row(e, 0) for e in estimates], ROW)


def _row(e: EnfEstimate, said: int) -> tuple[Any, ...]:
    h = e.header
    return (
        e.start_pts_ns, e.end_pts_ns, e.origin_pts_ns,
        e.t_s, e.enf_hz, e.enf_var_hz2, e.nominal_hz, e.mirror_hz or np.nan, *_phase(e),
        e.usable, e.is_reverse, said,
        h.frame_first, h.frame_last, h.pts_ns, h.camera_time_ns, h.arrival_time_ns,
    )  # fmt: skip


def _phase(e: EnfEstimate) -> tuple[float, float]:
    """Phase of an estimate's amplitude at twice the nominal frequency and its variance, or NaN."""
    if e.points == 1 and e.carrier_hz == 2.0 * e.nominal_hz:
        power = float(e.amplitude_re[0] ** 2 + e.amplitude_im[0] ** 2)
        if power > 0.0:
            both = (e.amplitude_var_re[0] + e.amplitude_var_im[0]) / 2.0
            return np.arctan2(e.amplitude_im[0], e.amplitude_re[0]), float(both) / power
    return np.nan, np.nan
