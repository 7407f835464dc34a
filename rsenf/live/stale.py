"""A stale feed's own story: since when it doesn't follow the grid, and where it was taken from."""

from __future__ import annotations

from rsenf.live import past
from rsenf.live.growing import GrowingGrid
from rsenf.live.past import Origin, OwnPast
from rsenf.live.settings import LiveSettings
from rsenf.live.ticks import Tick
from rsenf.messages import EnfEstimate
from rsenf.timebase import nanoseconds


class Suspects:
    """The estimates since a feed last followed the grid, and searches for where they are from.

    Attributes
    ----------
    origin : Origin or None
        How old the picture is, found in the reference.
    repeats : Origin or None
        The same, found in the feed's own past.
    since_ns : int or None
        Stream clock since when they don't follow the grid.
    """

    def __init__(self, settings: LiveSettings, own: OwnPast) -> None:
        self._youngest_s = settings.latest_s
        self._every_ns = nanoseconds(settings.search_every_s)
        self._own = own
        self._waiting: list[EnfEstimate] = []
        self._searched_ns: int | None = None
        self.clear()

    def clear(self) -> None:
        """Begin anew: they follow the grid after all."""
        self.jumped()
        self.repeats: Origin | None = None
        self.since_ns: int | None = None

    def jumped(self) -> None:
        """Begin anew to look for the time: the picture has jumped to another, as loops do."""
        self._waiting = []
        self.origin: Origin | None = None
        self._searched_ns = None

    def add(self, estimate: EnfEstimate) -> None:
        """Take an estimate that doesn't follow the grid."""
        if self.since_ns is None:
            self.since_ns = estimate.start_pts_ns
        self._waiting.append(estimate)
        del self._waiting[: -past.MOST_S]

    def search(self, tick: Tick, grid: GrowingGrid) -> None:
        """Look them up, when there are enough, nothing is known, and the last time is long ago."""
        known = self.origin is not None or tick.offset_ns is None
        if known or sum(e.usable for e in self._waiting) < past.LEAST_S:
            return
        if self._searched_ns is not None and tick.pts_ns - self._searched_ns < self._every_ns:
            return
        assert tick.offset_ns is not None
        self._searched_ns = tick.pts_ns
        self.repeats = self.repeats or self._own.repeated(self._waiting, tick.offset_ns)
        if grid.is_there:
            held = grid.held(self._waiting[-1].end_pts_ns + tick.offset_ns)
            self.origin = past.in_reference(self._waiting, tick.offset_ns, held, self._youngest_s)
