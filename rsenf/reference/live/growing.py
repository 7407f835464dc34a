"""A growing reference: every sample of its axis once and in order, as a value or as a gap.

The seconds of a stream, of a camera or a sound card, are put on the wall clock by their arrival
times. The two clocks drift apart, as the stream's is off by some parts per million. When they
differ by most of a sample, one sample becomes a gap, or one of the stream's is dropped, so that
each sample of the reference is sent once. A growing table is followed through truncation and
rotation (:func:`follow_table`).
"""

from __future__ import annotations

import codecs
import itertools
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages import Header, ReferenceBlock
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.axis import Raster, find_raster
from rsenf.reference.plausible import Unit, nominal_of, unit_of, without_outliers
from rsenf.reference.readings import ReadOptions, TimedRows
from rsenf.reference.reference import Notes
from rsenf.reference.table import encoding_of, table_columns
from rsenf.timebase import NO_ZONE, NS_PER_S, ArrivalClock, nanoseconds

# A new axis begins after a gap longer than a day, and when the clock was set back (waiting until it
# has caught up would lose data). Readings with their own times may come twice, as from a rewritten
# file, so more is allowed there.
MAX_GAP_S, SET_BACK_S, STAMPED_BACK_S = 86400.0, 3.0, 60.0
BLOCK = 3600  # most samples of a message
# Samples by which the clocks must differ before one is dropped or inserted. More than a half, for
# hysteresis against jitter.
PART_SAMPLES = 0.75
PIECE_BYTES = 1 << 22
# A header and some rows, enough to find the columns and the step between rows.
ENOUGH_LINES = 5
_LINE = re.compile(r"^[^#\s].*\n", re.MULTILINE)  # without comments
_NO_LINES = (".gz", ".parquet", ".pq", ".npz", ".wav")
Wait = Callable[[], bool]


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
        self._header = replace(self._header, epoch=self._header.epoch + 1, seq=0)

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
            header=replace(header, pts_ns=first * self.step_ns),
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


class OnTheClock:
    """Places the samples of one stream after another on a growing reference.

    Its ``clock`` is to be told when the stream's data arrive.

    Parameters
    ----------
    growing : Growing
    """

    def __init__(self, growing: Growing) -> None:
        self._growing = growing
        self.new_stream()

    def new_stream(self) -> None:
        """Begin another stream, whose clock is unrelated to the one before."""
        self.clock = ArrivalClock()
        self._last: tuple[int, int] | None = None  # start and number of the last sample

    def sample(self, start_ns: int, freq_hz: float, nominal_hz: float) -> list[ReferenceBlock]:
        """Add the sample that begins at ``start_ns`` on the stream's clock; return its blocks."""
        growing = self._growing
        time_ns = start_ns + (self.clock.offset_ns or 0)
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


def follow_table(
    path: Path, grid: str, options: ReadOptions, wait: Wait, run_id: str = ""
) -> Iterator[ReferenceBlock]:
    """Return a table's readings as blocks, and continue as it grows.

    Parameters
    ----------
    path : Path
        CSV with dated times; its present content comes first.
    grid : str
        Name of the reference.
    options : ReadOptions
    wait : callable
        Called when there is nothing new; waits a while, and returns whether to stop.
    run_id : str
        Identity of the run.

    Raises
    ------
    UsageError
        If there is no such file, or a file of its kind doesn't grow line by line.
    ReferenceFormatError
        If it can't be read as a reference, or has no dated times.
    """
    if not path.is_file():
        raise UsageError(f"no reference file {path}", "look for a misspelling")
    if path.suffix.lower() in _NO_LINES:
        raise UsageError(f"{path.name} doesn't grow line by line", "only CSV and WAV are followed")
    return _followed(path, grid, options, wait, run_id)


def _followed(
    path: Path, grid: str, options: ReadOptions, wait: Wait, run_id: str
) -> Iterator[ReferenceBlock]:
    growing: Growing | None = None
    for text in _generations(path, wait):
        notes = Notes()
        rows = TimedRows(path.name, options, notes)
        unit: Unit | None = None
        for columns in table_columns(text, path.name, options.column, notes, options.time_column):
            if columns.time is None:
                raise _undated(path)
            t_ns, freq_hz = rows.read(columns, more=True)
            rows.check()
            if not rows.dated:
                raise _undated(path)
            if not t_ns.size:
                continue
            unit = unit or unit_of(
                freq_hz, columns.frequency_name, path.name, options.deviations_from_hz, notes
            )
            freq_hz = unit.to_hz(freq_hz)
            growing = growing or _begun(path, grid, options, run_id, t_ns, freq_hz)
            growing.zone_unknown = NO_ZONE in notes.lines
            if options.stamp == "centre":
                t_ns = t_ns - growing.step_ns // 2
            freq_hz = without_outliers(freq_hz, growing.nominal_hz, notes)
            yield from growing.stamped(t_ns, freq_hz, growing.nominal_hz)


def _begun(
    path: Path, grid: str, options: ReadOptions, run_id: str, t_ns: Int64Array, freq_hz: FloatArray
) -> Growing:
    """Begin a reference from its first rows: nominal frequency, step, and raster."""
    nominal_hz = nominal_of(freq_hz, path.name, options.nominal_hz)
    raster = find_raster(t_ns, options.step_s, path.name)
    growing = Growing(grid, raster.step_ns / NS_PER_S, run_id)
    centre_ns = raster.step_ns // 2 if options.stamp == "centre" else 0
    growing.begin(raster.t0_ns - centre_ns, nominal_hz)
    return growing


def _undated(path: Path) -> ReferenceFormatError:
    return ReferenceFormatError(
        f"{path.name} has no times of day", "a file that grows must tell when each value was"
    )


def _generations(path: Path, wait: Wait) -> Iterator[Iterator[str]]:
    """Yield the file's text, and again after each truncation or replacement."""
    stopped = False

    def pause() -> bool:
        nonlocal stopped
        stopped = stopped or wait()
        return stopped

    while not stopped:
        try:
            file = path.open("rb")
        except OSError:  # removed, and not yet replaced
            pause()
            continue
        with file:
            text = _whole_lines(file, path, pause)
            if first := next(text, ""):
                yield itertools.chain([first], text)


def _whole_lines(file: BinaryIO, path: Path, pause: Wait) -> Iterator[str]:
    """Yield new text of a file in whole lines, until the file is replaced or the caller stops."""
    rest, enough, decoder = "", False, None
    while True:
        new = file.read(PIECE_BYTES)
        if new and decoder is None:
            decoder = codecs.getincrementaldecoder(encoding_of(new, path.name))("replace")
        rest += decoder.decode(new) if decoder else ""
        end = rest.rfind("\n") + 1
        enough = enough or len(_LINE.findall(rest)) >= ENOUGH_LINES
        if enough and end:
            yield rest[:end]
            rest = rest[end:]
        if not new and (is_another(path, file, file.tell()) or pause()):
            return


def is_another(path: Path, file: BinaryIO, least_bytes: int) -> bool:
    """Whether an open file was truncated, or replaced by another of that name.

    Parameters
    ----------
    path : Path
    file : BinaryIO
    least_bytes : int
        Size below which it was truncated.
    """
    ours = os.fstat(file.fileno())
    try:
        now = path.stat()
    except OSError:
        return False  # removed; a new one may follow
    return now.st_ino != ours.st_ino or now.st_size < least_bytes
