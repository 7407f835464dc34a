"""When there was something, as stretches of time without a hole; in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

KEPT = 4096
SHORTEST_HOLE_NS = 500_000_000


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
        while len(self._found) > KEPT:
            self.hole_ns *= 2
            self._found = joined(self._found, self.hole_ns)

    def all(self) -> list[Stretch]:
        """Return them in order."""
        return joined(self._found, self.hole_ns)
