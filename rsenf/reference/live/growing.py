"""A growing reference: every sample of its axis once and in order, as a value or as a gap.

The seconds of a stream, of a camera or a sound card, are put on the wall clock by their arrival
times. The two clocks drift apart, as the stream's is off by some parts per million. When they
differ by most of a sample, one sample becomes a gap, or one of the stream's is dropped, so that
each sample of the reference is sent once.
"""

from __future__ import annotations

import numpy as np

from rsenf.messages import Header, ReferenceBlock
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.axis import Raster
from rsenf.timebase import NS_PER_S, ArrivalClock, nanoseconds

# A new axis begins after a gap longer than a day, and when the clock was set back (waiting until it
# has caught up would lose data). Readings with their own times may come twice, as from a rewritten
# file, so more is allowed there.
MAX_GAP_S, SET_BACK_S, STAMPED_BACK_S = 86400.0, 3.0, 60.0
BLOCK = 3600  # most samples of a message


class Growing:
    """Turns readings with their sample numbers into consecutive blocks.

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
        Number of the next sample.
    late : int
        Number of readings dropped because their sample had been sent.
    zone_unknown : bool
        Whether the times have no zone.
    """

    def __init__(self, grid: str, step_s: float = 1.0, run_id: str = "") -> None:
        self.grid, self.step_s, self.step_ns = grid, step_s, nanoseconds(step_s)
        self.t0_ns = self.next = self.late = 0
        self.nominal_hz = float("nan")
        self.zone_unknown = False
        self._header = Header(run_id=run_id, source=f"reference/{grid}", epoch=-1)

    def covers(self, earliest_ns: int, latest_ns: int, back_s: float = SET_BACK_S) -> bool:
        """Whether times can continue this axis: not after a step back of the clock or a long gap.

        Parameters
        ----------
        earliest_ns, latest_ns : int
            UTC since 1970.
        back_s : float
            Largest step back.
        """
        next_ns = self.t0_ns + self.next * self.step_ns
        back = latest_ns < next_ns - nanoseconds(max(back_s, 3 * self.step_s))
        far = earliest_ns > next_ns + nanoseconds(MAX_GAP_S)
        return self._header.epoch >= 0 and not back and not far

    def begin(self, t0_ns: int, nominal_hz: float) -> None:
        """Begin an axis in a new epoch: the first, or one after a step of the clock.

        Parameters
        ----------
        t0_ns : int
            Its start, UTC since 1970.
        nominal_hz : float
            50 or 60.
        """
        self.t0_ns, self.nominal_hz, self.next = t0_ns, nominal_hz, 0
        header = self._header
        self._header = Header(run_id=header.run_id, source=header.source, epoch=header.epoch + 1)

    def stamped(
        self, t_ns: Int64Array, freq_hz: FloatArray, nominal_hz: float
    ) -> list[ReferenceBlock]:
        """Add readings, each to the sample that begins nearest to its time.

        Parameters
        ----------
        t_ns : ndarray of int, shape (n,)
            UTC since 1970. After a jump a new axis begins.
        freq_hz : ndarray of float, shape (n,)
            NaN for no reading.
        nominal_hz : float
            50 or 60.
        """
        leaps = np.abs(np.diff(t_ns)) > MAX_GAP_S * NS_PER_S
        out: list[ReferenceBlock] = []
        for part in np.split(np.arange(t_ns.size), np.flatnonzero(leaps) + 1):
            if not part.size:
                continue
            earliest_ns, latest_ns = int(t_ns[part].min()), int(t_ns[part].max())
            if not self.covers(earliest_ns, latest_ns, STAMPED_BACK_S):
                self.begin(earliest_ns, nominal_hz)
            index = Raster(self.t0_ns, self.step_ns).nearest(t_ns[part])
            out += self.append(index, freq_hz[part])
        return out

    def append(self, index: Int64Array, freq_hz: FloatArray) -> list[ReferenceBlock]:
        """Add readings; return them as blocks, with gaps between them.

        Parameters
        ----------
        index : ndarray of int, shape (n,)
            Their samples, in order. The first of several readings of a sample counts.
        freq_hz : ndarray of float, shape (n,)
            NaN for no reading.
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
            zone_unknown=self.zone_unknown,
        )


# Samples by which the clocks must differ before one is dropped or inserted. More than a half, for
# hysteresis against jitter.
PART_SAMPLES = 0.75


class OnTheClock:
    """Places the samples of one stream after another on a growing reference.

    Parameters
    ----------
    growing : Growing
    """

    def __init__(self, growing: Growing) -> None:
        self._growing = growing
        self.new_stream()

    def new_stream(self) -> None:
        """Begin another stream, whose clock is unrelated to the one before."""
        self._clock = ArrivalClock()
        self._last: tuple[int, int] | None = None  # start and number of the last sample

    def note(self, pts_ns: int, arrival_ns: int) -> None:
        """Record the arrival time of data at ``pts_ns`` on the stream's clock; 0 is unknown."""
        self._clock.note(pts_ns, arrival_ns)

    def sample(self, start_ns: int, freq_hz: float, nominal_hz: float) -> list[ReferenceBlock]:
        """Add the sample that begins at ``start_ns`` on the stream's clock; return its blocks."""
        growing = self._growing
        time_ns = start_ns + (self._clock.offset_ns or 0)
        if not growing.covers(time_ns, time_ns):
            growing.begin(time_ns, nominal_hz)
        index = self._index(start_ns, (time_ns - growing.t0_ns) / growing.step_ns)
        self._last = start_ns, index
        return growing.append(np.array([index]), np.array([freq_hz]))

    def _index(self, start_ns: int, by_clock: float) -> int:
        """Count on from the last sample, unless this has drifted too far from the wall clock."""
        if self._last is None:
            return round(by_clock)
        last_ns, last = self._last
        counted = last + round((start_ns - last_ns) / self._growing.step_ns)
        return counted if abs(by_clock - counted) < PART_SAMPLES else round(by_clock)
