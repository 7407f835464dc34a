"""This host's clock of the day, which may be set: what goes by it should know when."""

from __future__ import annotations

import time
from collections.abc import Callable

from rsenf.timebase import NS_PER_S

SET_NS = NS_PER_S // 2  # what happens between two looks at the clocks is far below


class HostClock:
    """Tells the time of day, UTC since 1970 in ns, and notices when somebody sets it.

    Intervals are measured by the steady clock everywhere; a clock that is set changes what arrival
    times say from then on, and ends nothing.

    Parameters
    ----------
    on_set : callable
        Told, in one line, by how much it was set.
    wall_ns, steady_ns : callable
        The clock of the day, and one that nobody sets.
    """

    def __init__(
        self,
        on_set: Callable[[str], None],
        wall_ns: Callable[[], int] = time.time_ns,
        steady_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._on_set, self._wall_ns, self._steady_ns = on_set, wall_ns, steady_ns
        self._apart_ns = wall_ns() - steady_ns()

    def __call__(self) -> int:
        """Return the time."""
        now_ns = self._wall_ns()
        before_ns, self._apart_ns = self._apart_ns, now_ns - self._steady_ns()
        by_ns = self._apart_ns - before_ns
        if abs(by_ns) > SET_NS:
            self._on_set(f"this host's clock was set by {by_ns / NS_PER_S:+.1f} s")
        return now_ns
