"""A reference that grows while it is used: blocks in, as they come; one uniform grid out."""

from __future__ import annotations

import math

import numpy as np

from rsenf.match.forecast import forecast
from rsenf.match.series import Grid
from rsenf.messages import ReferenceBlock
from rsenf.messages.schema import FloatArray
from rsenf.timebase import nanoseconds, seconds

BESIDE_SAMPLES = 2  # after an instant, which the slope at it is taken from
GROWTH = 4096  # samples that room is made for at once


class GrowingGrid:
    """The reference so far.

    What is older than the hours kept, or lies beyond them ahead, is thrown away: a wrong time in
    one block must not take all memory.

    Parameters
    ----------
    keep_hours : float
    """

    def __init__(self, keep_hours: float) -> None:
        self._keep_s = 3600.0 * keep_hours
        self._freq_hz: FloatArray = np.empty(0)
        self._first = self._end = 0  # numbers of the samples held
        self._like: ReferenceBlock | None = None
        self._total = 0

    def add(self, block: ReferenceBlock) -> None:
        """Take a block in; one that comes again overwrites itself."""
        if not block.samples or not block.t0_ns or block.step_ns <= 0:
            return
        if self._like is None or not _same(self._like, block):
            self._like = block
            self._freq_hz, self._first, self._end = np.empty(0), block.first, block.first
        self._total = max(self._total, block.total)
        self._make_room(block.first, block.first + block.samples)
        start = max(block.first, self._first)
        there = slice(start - self._first, block.first + block.samples - self._first)
        self._freq_hz[there] = block.freq_hz[start - block.first :]
        self._end = max(self._end, block.first + block.samples)

    def _make_room(self, first: int, end: int) -> None:
        room = self._first + self._freq_hz.size
        before = max(self._first - first, 0) if self._first == self._end else 0
        self._first -= before
        more = GROWTH + end - room if end > room else 0
        if before or more:
            self._freq_hz = np.pad(self._freq_hz, (before, more), constant_values=np.nan)

    def forget_before(self, utc_ns: int) -> None:
        """Throw away what is older than the hours kept, before a time; seldom, and much at once."""
        if self._like is None:
            return
        old = int(self._at_s(utc_ns) - self._keep_s / self.step_s) - self._first
        if old > GROWTH:
            self._freq_hz = self._freq_hz[old:].copy()
            self._first += old

    @property
    def is_there(self) -> bool:
        """Whether there is any, with a known time."""
        return self._like is not None

    @property
    def is_whole(self) -> bool:
        """Whether nothing more will come."""
        return 0 < self._total <= self._end

    @property
    def nominal_hz(self) -> float:
        """50 or 60; NaN while there is none."""
        return self._like.nominal_hz if self._like else math.nan

    @property
    def step_s(self) -> float:
        """Time between samples."""
        assert self._like is not None
        return seconds(self._like.step_ns)

    @property
    def name(self) -> str:
        """Name of the grid; empty while there is none."""
        return self._like.grid if self._like else ""

    def end_ns(self) -> int:
        """End of the last sample, UTC; 0 while there is none."""
        return self._like.t0_ns + self._end * self._like.step_ns if self._like else 0

    def covers(self, utc_ns: int) -> bool:
        """Whether all is here that will ever be told of a time."""
        beside_ns = nanoseconds(BESIDE_SAMPLES * self.step_s) if self._like else 0
        return self.is_there and (self.is_whole or self.end_ns() >= utc_ns + beside_ns)

    def moved(self, from_ns: int, passed_s: float, lag_s: FloatArray) -> FloatArray | None:
        """How far its phase goes within some seconds after a time, less each of some lags.

        Returns
        -------
        ndarray, shape (lags,), or None
            Radians of the illumination less the nominal; None where it has a gap.
        """
        if self._like is None:
            return None
        at_s = (self._at_s(from_ns) - self._first) * self.step_s - lag_s
        phase, known = forecast(self.held(), at_s, np.array([0.0, passed_s]))
        return phase[1] - phase[0] if known[1].all() else None

    def held(self, until_ns: int | None = None) -> Grid:
        """Return what is held, up to a time, as one grid."""
        assert self._like is not None
        stop = self._end - self._first
        if until_ns is not None:
            stop = int(np.clip(math.floor(self._at_s(until_ns)) - self._first, 0, stop))
        t0_ns = self._like.t0_ns + self._first * self._like.step_ns
        freq_hz = self._freq_hz[:stop]
        return Grid(self._like.grid, self._like.nominal_hz, t0_ns, self.step_s, freq_hz)

    def _at_s(self, utc_ns: int) -> float:
        """Place of a time, in samples after the reference's first."""
        assert self._like is not None
        return (utc_ns - self._like.t0_ns) / self._like.step_ns


def _same(one: ReferenceBlock, other: ReferenceBlock) -> bool:
    """Whether two blocks lie on one axis: who sends them may have begun anew."""
    return (one.t0_ns, one.step_ns, one.grid) == (other.t0_ns, other.step_ns, other.grid)
