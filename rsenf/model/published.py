"""The paper's printed idle tables as data, errors included."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """A row of an idle table: the two strongest lines and the ratio of their amplitudes.

    Frequencies are tuples, with several values where lines tie. ``amplitude_ratio`` is None where
    it is infinite.
    """

    idle_percent: int
    h1_hz: tuple[float, ...]
    h2_hz: tuple[float, ...]
    amplitude_ratio: float | None
    ratio_range: tuple[float, float] | None = None  # over the light's phase, if it depends on it

    def agrees(self, other: Entry) -> bool:
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
    entries: tuple[Entry, ...]


PUBLISHED_TABLES = (
    PublishedTable(
        "Table: Harmonic vs idle for 30 fps",
        29.97,
        50.0,
        (
            Entry(0, (100,), (0,), None),
            Entry(5, (100,), (70,), 5.0),
            Entry(10, (100,), (70,), 2.0),
            Entry(15, (100, 70), (100, 70), 1.0),
            Entry(20, (70,), (100,), 2.0),
            Entry(25, (70,), (100,), 5.0),
            Entry(30, (70,), (100, 40), 505.6),
            Entry(35, (70,), (40,), 5.0),
            Entry(40, (70,), (40,), 2.0),
            Entry(45, (70, 40), (70, 40), 1.0),
            Entry(50, (40,), (70,), 2.0),
            Entry(55, (40,), (70,), 5.0),
            Entry(60, (40,), (10, 70), 498.5),
            Entry(65, (40,), (10,), 4.9),
            Entry(70, (40,), (10,), 2.0),
            Entry(75, (40, 10), (40, 10), 1.0),
            Entry(80, (10,), (40,), 2.0),
            Entry(85, (10,), (40,), 5.1),
            Entry(90, (10,), (40,), 334.0),
            Entry(95, (10,), (40,), 6.9),
        ),
    ),
    PublishedTable(
        "Table: Harmonic vs idle for 25 fps",
        25.0,
        50.0,
        (
            Entry(0, (100,), (0,), None),
            Entry(5, (100,), (75,), 4.0),
            Entry(10, (100,), (75,), 1.5),
            Entry(15, (75,), (100,), 1.5),
            Entry(20, (75,), (100,), 4.0),
            Entry(25, (75,), (100,), None),
            Entry(30, (75,), (50,), 4.0),
            Entry(35, (75,), (50,), 1.5),
            Entry(40, (50,), (75,), 1.5),
            Entry(45, (50,), (75,), 4.0),
            Entry(50, (50,), (100,), None),
            Entry(55, (50,), (25,), 4.0),
            Entry(60, (50,), (25,), 1.5),
            Entry(65, (25,), (50,), 1.5),
            Entry(70, (25,), (50,), 4.0),
            Entry(75, (25,), (75,), None),
            Entry(80, (25,), (50,), 6.0),
            Entry(85, (25,), (50,), 3.5),
            Entry(90, (25,), (50,), 2.7),
            Entry(95, (25,), (50,), 2.2),
        ),
    ),
)
