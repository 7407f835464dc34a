"""A grid's measured frequency on one uniform axis, with its gaps, and notes on how it was read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsenf.messages import Header, ReferenceBlock
from rsenf.messages.schema import FloatArray, UInt32Array
from rsenf.timebase import NO_ZONE, nanoseconds


class Notes:
    """Lines in the order of their first mention; a counted line ends with its count.

    Examples
    --------
    >>> notes = Notes()
    >>> notes.count("gaps", 2)
    >>> notes.count("gaps", 1)
    >>> notes.lines
    ['gaps: 3']
    """

    def __init__(self) -> None:
        self._counts: dict[str, int | None] = {}

    def say(self, text: str) -> None:
        """Add a line, unless it is there already."""
        self._counts.setdefault(text, None)

    def count(self, text: str, times: int) -> None:
        """Add to the count of a line; a count of 0 adds no line."""
        if times:
            self._counts[text] = (self._counts.get(text) or 0) + int(times)

    @property
    def lines(self) -> list[str]:
        """The lines so far."""
        return [text if n is None else f"{text}: {n}" for text, n in self._counts.items()]


@dataclass(frozen=True, eq=False)
class Reference:
    """A reference: sample ``k`` covers ``[t0 + k·step, t0 + (k + 1)·step)``, not interpolated.

    Parameters
    ----------
    grid : str
        Name of the grid.
    nominal_hz : float
        50 or 60.
    t0_ns : int
        Start of the first sample, UTC since 1970; 0 if unknown.
    step_s : float
        Time between samples.
    freq_hz : ndarray of float, shape (n,)
        NaN in gaps.
    readings : ndarray of uint32, shape (n,)
        Number of readings of each sample: 0 is a gap, above 1 are duplicates.
    notes : tuple of str
        One line for each thing found or assumed.
    sha256 : str
        Of the file, as hexadecimal.
    name : str
        Of the file, without its folder.
    size_bytes : int or None
        Of the file, if it is one.
    """

    grid: str
    nominal_hz: float
    t0_ns: int
    step_s: float
    freq_hz: FloatArray
    readings: UInt32Array
    notes: tuple[str, ...] = ()
    sha256: str = ""
    name: str = ""
    size_bytes: int | None = None

    @property
    def duration_s(self) -> float:
        """Time from the first sample's start to the last one's end."""
        return self.freq_hz.size * self.step_s

    @property
    def end_ns(self) -> int:
        """End of the last sample, UTC since 1970; 0 if unknown."""
        return self.t0_ns + nanoseconds(self.duration_s) if self.t0_ns else 0

    @property
    def zone_unknown(self) -> bool:
        """Whether its times have no zone and none was given: they were taken as UTC."""
        return NO_ZONE in self.notes

    @property
    def valid_samples(self) -> int:
        """Number of samples that aren't gaps."""
        return int(np.isfinite(self.freq_hz).sum())

    @property
    def gaps(self) -> int:
        """Number of gaps."""
        return len(gap_lengths(self.freq_hz))

    @property
    def duplicates(self) -> int:
        """Number of samples with more than one reading."""
        return int((np.asarray(self.readings) > 1).sum())


def reference_blocks(
    reference: Reference, *, source: str, run_id: str = "", block: int = 3600
) -> Iterator[ReferenceBlock]:
    """Cut a reference into messages.

    Parameters
    ----------
    reference : Reference
    source : str
        ``reference/<grid>``.
    run_id : str
        Identity of the run.
    block : int
        Samples in each but the last.
    """
    step_ns = nanoseconds(reference.step_s)
    for seq, first in enumerate(range(0, reference.freq_hz.size, block)):
        span = slice(first, first + block)
        freq = reference.freq_hz[span]
        yield ReferenceBlock(
            header=Header(run_id=run_id, source=source, seq=seq, pts_ns=first * step_ns),
            grid=reference.grid,
            nominal_hz=reference.nominal_hz,
            t0_ns=reference.t0_ns,
            step_ns=step_ns,
            first=first,
            samples=freq.size,
            total=reference.freq_hz.size,
            freq_hz=freq,
            readings=reference.readings[span],
            zone_unknown=reference.zone_unknown,
        )


def gap_lengths(freq_hz: FloatArray) -> list[int]:
    """Length of each run of NaN in samples, in order.

    Examples
    --------
    >>> gap_lengths(np.array([50.0, np.nan, np.nan, 50.0, np.nan]))
    [2, 1]
    """
    edges = np.flatnonzero(np.diff(np.isnan(freq_hz), prepend=False, append=False))
    return [int(n) for n in edges[1::2] - edges[::2]]
