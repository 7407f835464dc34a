"""The host's wall clock, with detection of steps: somebody may set it."""

from __future__ import annotations

import time
from collections.abc import Callable

from rsenf.timebase import NS_PER_S

SET_NS = NS_PER_S // 2  # far above the time between reading the two clocks


class HostClock:
    """Returns the wall clock, UTC since 1970 in ns, and reports when it is set.

    Intervals are measured with the monotonic clock everywhere, so a step changes later arrival
    times but ends nothing.

    Parameters
    ----------
    on_set : callable
        Called with one line of text that says by how much the clock was set.
    wall_ns, steady_ns : callable
        The wall clock and a monotonic clock, in ns.
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
