"""Times with messages, as intervals ('stretches') without a hole, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from statistics import median
from typing import NamedTuple

KEPT = 4096
SHORTEST_HOLE_NS = 500_000_000
DENSE = 4  # messages per stretch from which the usual interval is taken within stretches


class Stretch(NamedTuple):
    """A time interval, both ends included."""

    first_ns: int
    last_ns: int


def joined(stretches: Iterable[Stretch], hole_ns: int) -> list[Stretch]:
    """Sort stretches, and merge those at most ``hole_ns`` apart.

    Examples
    --------
    >>> joined([Stretch(7, 9), Stretch(0, 4), Stretch(5, 6)], 1)
    [Stretch(first_ns=0, last_ns=9)]
    """
    out: list[Stretch] = []
    for stretch in sorted(stretches):
        if out and stretch.first_ns - out[-1].last_ns <= hole_ns:
            out[-1] = Stretch(out[-1].first_ns, max(out[-1].last_ns, stretch.last_ns))
        else:
            out.append(stretch)
    return out


def at_most(stretches: Iterable[Stretch], hole_ns: int, most: int) -> tuple[list[Stretch], int]:
    """Merge stretches over ever longer holes, until few enough are left.

    Parameters
    ----------
    stretches : iterable of Stretch
    hole_ns : int
        Longest hole merged at first; it is doubled as often as necessary.
    most : int
        Number of stretches to be left at most.

    Returns
    -------
    stretches : list of Stretch
    hole_ns : int
        The longest hole that was merged.
    """
    out = joined(stretches, hole_ns)
    while len(out) > most:
        hole_ns = max(2 * hole_ns, 1)
        out = joined(out, hole_ns)
    return out, hole_ns


def usual_interval_ns(stretches: Iterable[Stretch], messages: int) -> int:
    """Return the usual interval between two messages of a topic.

    Parameters
    ----------
    stretches : iterable of Stretch
        Times with messages; rare messages have a stretch each.
    messages : int
        Number of messages in all of them.
    """
    there = sorted(stretches)
    if len(there) > 1 and messages < DENSE * len(there):
        return round(median(b.first_ns - a.first_ns for a, b in pairwise(there)))
    return sum(s.last_ns - s.first_ns for s in there) // max(messages, 1)


class Stretches:
    """Collects stretches.

    Attributes
    ----------
    hole_ns : int
        Holes up to this length are merged; it grows when there are too many stretches.
    """

    def __init__(self) -> None:
        self.hole_ns = SHORTEST_HOLE_NS
        self._found: list[Stretch] = []

    def add(self, stretch: Stretch) -> None:
        """Add a stretch, usually later than those before."""
        self._found[-1:] = joined([*self._found[-1:], stretch], self.hole_ns)
        if len(self._found) > KEPT:
            self._found, self.hole_ns = at_most(self._found, self.hole_ns, KEPT)

    def all(self) -> list[Stretch]:
        """Return the stretches in order."""
        return joined(self._found, self.hole_ns)
