"""A reference that grows: every sample of its axis once, as a value or as a gap, and in order."""

from __future__ import annotations

import numpy as np

from rsenf.messages import Header, ReferenceBlock
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.timebase import nanoseconds

MAX_GAP_S = 86400.0  # beyond it an axis begins anew, rather than be filled with nothing
BLOCK = 3600  # samples of a message at most


class Growing:
    """Turns readings with their places on a uniform axis into blocks that follow each other.

    Parameters
    ----------
    grid : str
        Name of the grid.
    step_s : float
        Time between samples.
    run_id : str
        Identity of the run.

    Attributes
    ----------
    t0_ns : int
        Start of the axis, UTC since 1970; set by :meth:`begin`.
    next : int
        Sample that comes next.
    late : int
        Readings of samples that had been told already: left out.
    """

    def __init__(self, grid: str, step_s: float = 1.0, run_id: str = "") -> None:
        self.grid, self.step_ns = grid, nanoseconds(step_s)
        self.t0_ns = self.next = self.late = 0
        self.nominal_hz = float("nan")
        self._header = Header(run_id=run_id, source=f"reference/{grid}", epoch=-1)

    @property
    def begun(self) -> bool:
        """Whether there is an axis."""
        return self._header.epoch >= 0

    @property
    def max_gap(self) -> int:
        """Samples that may be missing in a row before the axis should begin anew."""
        return nanoseconds(MAX_GAP_S) // self.step_ns

    def begin(self, t0_ns: int, nominal_hz: float) -> None:
        """Begin an axis, in an epoch of its own: the first, or one after the clock was set."""
        self.t0_ns, self.nominal_hz, self.next = t0_ns, nominal_hz, 0
        header = self._header
        self._header = Header(run_id=header.run_id, source=header.source, epoch=header.epoch + 1)

    def nearest(self, t_ns: Int64Array) -> Int64Array:
        """Return the samples that begin nearest to times."""
        return (t_ns - self.t0_ns + self.step_ns // 2) // self.step_ns

    def append(self, index: Int64Array, freq_hz: FloatArray) -> list[ReferenceBlock]:
        """Add readings; return them as blocks, what lies between as gaps.

        Parameters
        ----------
        index : ndarray of int, shape (n,)
            Their samples, in order. Of several readings of a sample the first counts.
        freq_hz : ndarray of float, shape (n,)
            NaN for none.
        """
        index, first = np.unique(index, return_index=True)
        new = index >= self.next
        self.late += freq_hz.size - int(new.sum())
        index, freq_hz = index[new], freq_hz[first][new]
        if not index.size:
            return []
        values = np.full(int(index[-1]) + 1 - self.next, np.nan)
        values[index - self.next] = freq_hz
        return [self._block(values[k : k + BLOCK]) for k in range(0, values.size, BLOCK)]

    def _block(self, values: FloatArray) -> ReferenceBlock:
        first, self.next = self.next, self.next + values.size
        header = self._header
        self._header = header.numbered(header.seq + 1)
        return ReferenceBlock(
            header=Header(
                run_id=header.run_id,
                source=header.source,
                epoch=header.epoch,
                seq=header.seq,
                pts_ns=first * self.step_ns,
            ),
            grid=self.grid,
            nominal_hz=self.nominal_hz,
            t0_ns=self.t0_ns,
            step_ns=self.step_ns,
            first=first,
            samples=values.size,
            freq_hz=values,
            readings=np.isfinite(values).astype(np.uint32),
        )
