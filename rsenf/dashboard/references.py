"""Published grid frequencies, by time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rsenf.dashboard.plain import LATEST_NS, sensible
from rsenf.messages import ReferenceBlock

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
