"""The idle tables: the two strongest lines and their amplitude ratio, against the idle period.

The strongest line is that of Eq. 22 (``Eq_arg_max``). The paper calls the ratio one of powers; its
values are ratios of amplitudes, as they are here. The printed tables are here as data, errors
included.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.errors import UsageError
from rsenf.model.analytic import COSINE, PHASES_RAD, ROWS, SpectralLine, lines

IDLE_PERCENTS = range(0, 100, 5)
PRINTED_TIE = 1.05  # smaller ratios are printed as 1.0
_EQUAL = 1 + 1e-6
_NOTHING = 1e-9  # rounding error, relative to the strongest line


@dataclass(frozen=True)
class Row:
    """A row of an idle table: the two strongest lines and the ratio of their amplitudes.

    Frequencies are tuples, with several values where lines tie. ``amplitude_ratio`` is None where
    it is infinite.
    """

    idle_percent: int
    h1_hz: tuple[float, ...]
    h2_hz: tuple[float, ...]
    amplitude_ratio: float | None
    ratio_range: tuple[float, float] | None = None  # over the light's phase, if it depends on it

    def agrees(self, other: Row) -> bool:
        """Whether both have the same lines, in any order, and ratios equal within 0.05."""
        mine, yours = self.amplitude_ratio, other.amplitude_ratio
        same = mine == yours if mine is None or yours is None else abs(mine - yours) < 0.05
        lines = (set(e.h1_hz) for e in (self, other)), (set(e.h2_hz) for e in (self, other))
        return same and all(a == b for a, b in lines)


@dataclass(frozen=True)
class PublishedTable:
    """An idle table of the paper."""

    label: str
    frame_rate_hz: float  # as printed; the broadcast rate would be 30000/1001
    nominal_hz: float
    entries: tuple[Row, ...]


PUBLISHED_TABLES = (
    PublishedTable(
        "Table: Harmonic vs idle for 30 fps",
        29.97,
        50.0,
        (
            Row(0, (100,), (0,), None),
            Row(5, (100,), (70,), 5.0),
            Row(10, (100,), (70,), 2.0),
            Row(15, (100, 70), (100, 70), 1.0),
            Row(20, (70,), (100,), 2.0),
            Row(25, (70,), (100,), 5.0),
            Row(30, (70,), (100, 40), 505.6),
            Row(35, (70,), (40,), 5.0),
            Row(40, (70,), (40,), 2.0),
            Row(45, (70, 40), (70, 40), 1.0),
            Row(50, (40,), (70,), 2.0),
            Row(55, (40,), (70,), 5.0),
            Row(60, (40,), (10, 70), 498.5),
            Row(65, (40,), (10,), 4.9),
            Row(70, (40,), (10,), 2.0),
            Row(75, (40, 10), (40, 10), 1.0),
            Row(80, (10,), (40,), 2.0),
            Row(85, (10,), (40,), 5.1),
            Row(90, (10,), (40,), 334.0),
            Row(95, (10,), (40,), 6.9),
        ),
    ),
    PublishedTable(
        "Table: Harmonic vs idle for 25 fps",
        25.0,
        50.0,
        (
            Row(0, (100,), (0,), None),
            Row(5, (100,), (75,), 4.0),
            Row(10, (100,), (75,), 1.5),
            Row(15, (75,), (100,), 1.5),
            Row(20, (75,), (100,), 4.0),
            Row(25, (75,), (100,), None),
            Row(30, (75,), (50,), 4.0),
            Row(35, (75,), (50,), 1.5),
            Row(40, (50,), (75,), 1.5),
            Row(45, (50,), (75,), 4.0),
            Row(50, (50,), (100,), None),
            Row(55, (50,), (25,), 4.0),
            Row(60, (50,), (25,), 1.5),
            Row(65, (25,), (50,), 1.5),
            Row(70, (25,), (50,), 4.0),
            Row(75, (25,), (75,), None),
            Row(80, (25,), (50,), 6.0),
            Row(85, (25,), (50,), 3.5),
            Row(90, (25,), (50,), 2.7),
            Row(95, (25,), (50,), 2.2),
        ),
    ),
)


@dataclass(frozen=True)
class Strongest:
    """The strongest lines ``H_1``, the second strongest ``H_2``, and their ratio.

    Lines of equal amplitude share a rank, the highest frequency first. If several share the first
    rank, they are both ``H_1`` and ``H_2``, as in the paper. If the light makes a single line,
    ``second`` is empty and ``amplitude_ratio`` None.
    """

    first: tuple[SpectralLine, ...]
    second: tuple[SpectralLine, ...]
    amplitude_ratio: float | None
    ratio_range: tuple[float, float] | None  # over the light's phase; None if independent of it


def strongest(found: Iterable[SpectralLine], tie_ratio: float = _EQUAL) -> Strongest:
    """Select the two strongest lines, by their rms over the light's phase (paper, Eq. 22).

    Parameters
    ----------
    found : iterable of SpectralLine
        From :func:`rsenf.model.analytic.lines`.
    tie_ratio : float, optional
        Amplitudes with a smaller ratio are equal.

    Raises
    ------
    UsageError
        When there is no line.
    """
    ordered = sorted(found, key=lambda line: -line.amplitude)
    if not ordered:
        raise UsageError("there is no line to pick from", "raise the highest frequency")
    first = _sharing(ordered, tie_ratio)
    if len(ordered) < 2 or ordered[1].amplitude < _NOTHING * ordered[0].amplitude:
        return Strongest(first, (), None, None)
    one, two = ordered[:2]
    second = first if len(first) > 1 else _sharing(ordered[1:], tie_ratio)
    return Strongest(first, second, one.amplitude / two.amplitude, _ratio_range(one, two))


def _sharing(ordered: Sequence[SpectralLine], tie_ratio: float) -> tuple[SpectralLine, ...]:
    """Lines that share the first one's rank, the highest frequency first."""
    least = ordered[0].amplitude / tie_ratio
    alike = (line for line in ordered if line.amplitude > least)
    return tuple(sorted(alike, key=lambda line: -line.freq_hz))


def _ratio_range(one: SpectralLine, two: SpectralLine) -> tuple[float, float] | None:
    if len(one.parts) == len(two.parts) == 1:
        return None
    with np.errstate(divide="ignore"):
        ratio = one.at_phase(PHASES_RAD) / two.at_phase(PHASES_RAD)
    return float(ratio.min()), float(ratio.max())


@dataclass(frozen=True)
class ModelReading:
    """How the line model is read: by default exactly, otherwise as the paper did."""

    whole_capacity: bool = False  # M = round(L/(1 − ρ)), which changes ρ slightly
    folded: bool = True  # include lines below 0 Hz, at their absolute value
    harmonics: tuple[float, ...] = COSINE
    rows: int = ROWS

    def lines(
        self, frame_rate_hz: float, nominal_hz: float, idle_ratio: float
    ) -> tuple[SpectralLine, ...]:
        """List the lines of a capture, up to slightly beyond twice the light's highest harmonic."""
        if self.whole_capacity:
            idle_ratio = 1 - self.rows / round(self.rows / (1 - idle_ratio))
        f0_hz = 2 * nominal_hz
        return lines(
            frame_rate_hz,
            f0_hz,
            idle_ratio,
            rows=self.rows,
            harmonics=self.harmonics,
            folded=self.folded,
            top_hz=2 * f0_hz * len(self.harmonics) + frame_rate_hz,
        )


AS_PUBLISHED = ModelReading(whole_capacity=True, folded=False)


def idle_table(
    frame_rate_hz: float,
    nominal_hz: float,
    reading: ModelReading,
    idle_percents: Iterable[int] = IDLE_PERCENTS,
) -> tuple[Row, ...]:
    """Tabulate the two strongest lines, unrounded; only equal amplitudes tie (paper, Eq. 22).

    Parameters
    ----------
    frame_rate_hz, nominal_hz : float
        Frame rate, and frequency of the grid.
    reading : ModelReading
    idle_percents : iterable of int, optional
    """
    return tuple(
        _entry(idle, reading.lines(frame_rate_hz, nominal_hz, idle / 100)) for idle in idle_percents
    )


def printed_table(
    frame_rate_hz: float,
    nominal_hz: float,
    reading: ModelReading,
    idle_percents: Iterable[int] = IDLE_PERCENTS,
) -> tuple[Row, ...]:
    """Tabulate as the paper prints: whole hertz, one decimal, a tie where that ratio is 1.0.

    Takes the same arguments as :func:`idle_table`.

    Examples
    --------
    >>> (row,) = printed_table(29.97, 50.0, AS_PUBLISHED, [30])
    >>> row.h1_hz, row.h2_hz, row.amplitude_ratio
    ((70,), (100, 40), 505.6)
    """
    return tuple(
        _as_printed(_entry(idle, reading.lines(frame_rate_hz, nominal_hz, idle / 100), PRINTED_TIE))
        for idle in idle_percents
    )


def _entry(idle_percent: int, found: tuple[SpectralLine, ...], tie_ratio: float = _EQUAL) -> Row:
    top = strongest(found, tie_ratio)
    first, second = (tuple(line.freq_hz for line in rank) for rank in (top.first, top.second))
    return Row(idle_percent, first, second, top.amplitude_ratio, top.ratio_range)


def _as_printed(entry: Row) -> Row:
    ratio = entry.amplitude_ratio
    return Row(
        entry.idle_percent,
        tuple(round(hz) for hz in entry.h1_hz),
        tuple(round(hz) for hz in entry.h2_hz),
        None if ratio is None else round(ratio, 1),
    )
