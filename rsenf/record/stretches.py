"""When there was something, as stretches of time without a hole; in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from statistics import median
from typing import NamedTuple

KEPT = 4096
SHORTEST_HOLE_NS = 500_000_000
DENSE = 4  # messages for each stretch, from which on the time between them is that within stretches


class Stretch(NamedTuple):
    """A stretch of time, both ends included."""

    first_ns: int
    last_ns: int


def joined(stretches: Iterable[Stretch], hole_ns: int) -> list[Stretch]:
    """Return stretches in order, those with no more than ``hole_ns`` between them as one."""
    out: list[Stretch] = []
    for stretch in sorted(stretches):
        if out and stretch.first_ns - out[-1].last_ns <= hole_ns:
            out[-1] = Stretch(out[-1].first_ns, max(out[-1].last_ns, stretch.last_ns))
        else:
            out.append(stretch)
    return out


def at_most(stretches: Iterable[Stretch], hole_ns: int, most: int) -> tuple[list[Stretch], int]:
    """Join stretches over ever longer holes, from ``hole_ns`` on, until there are few enough.

    Returns
    -------
    stretches : list of Stretch
    hole_ns : int
        The longest hole that doesn't show.
    """
    out = joined(stretches, hole_ns)
    while len(out) > most:
        hole_ns = max(2 * hole_ns, 1)
        out = joined(out, hole_ns)
    return out, hole_ns


def usual_interval_ns(stretches: Iterable[Stretch], messages: int) -> int:
    """Time that usually lies between two messages of a topic.

    Parameters
    ----------
    stretches : iterable of Stretch
        When there were messages; a seldom one makes a stretch of its own.
    messages : int
        How many there were in all of them.
    """
    there = sorted(stretches)
    if len(there) > 1 and messages < DENSE * len(there):
        return round(median(b.first_ns - a.first_ns for a, b in pairwise(there)))
    return sum(s.last_ns - s.first_ns for s in there) // max(messages, 1)


class Stretches:
    """Collects stretches of time.

    Attributes
    ----------
    hole_ns : int
        Shortest hole that shows; it grows when there are too many to remember.
    """

    def __init__(self) -> None:
        self.hole_ns = SHORTEST_HOLE_NS
        self._found: list[Stretch] = []

    def add(self, stretch: Stretch) -> None:
        """Add one, as a rule later than those before."""
        self._found[-1:] = joined([*self._found[-1:], stretch], self.hole_ns)
        if len(self._found) > KEPT:
            self._found, self.hole_ns = at_most(self._found, self.hole_ns, KEPT)

    def all(self) -> list[Stretch]:
        """Return them in order."""
        return joined(self._found, self.hole_ns)
