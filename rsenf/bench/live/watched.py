"""All that a monitor receives of a feed and its grid, in the order in which it comes."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsenf.bench.live.estimates import estimates_of
from rsenf.bench.live.footage import Shown, show
from rsenf.bench.live.grids import reference_blocks
from rsenf.bench.live.plan import Feed
from rsenf.timebase import seconds


@dataclass(frozen=True, eq=False)
class Watch:
    """A feed watched: what was shown, and the messages about it.

    Parameters
    ----------
    shown : Shown
    messages : list
        Of :mod:`rsenf.messages`, in the order of their arrival.
    """

    shown: Shown
    messages: list[Any]

    def since_begin_s(self, host_ns: int) -> float:
        """Time of the host's clock since the feed's first rows came."""
        return seconds(host_ns - self.shown.blocks[0].header.arrival_time_ns)


def watch(feed: Feed, grids: Path | None, kept: Path | None) -> Watch:
    """Watch a feed.

    Parameters
    ----------
    feed : Feed
    grids, kept : Path or None
        Folders of measured grids, and of estimates that were made before.
    """
    shown = show(feed, grids)
    nominal_hz = shown.watched.stretch.nominal_hz
    streams = (
        reference_blocks(shown.watched, feed.length_s, feed.seed),
        shown.blocks,
        estimates_of(feed, shown.blocks, nominal_hz, kept),
    )
    return Watch(shown, list(_in_order(streams)))


def _in_order(streams: Any) -> Iterator[Any]:
    """Merge streams by their arrival; at one instant, in the order of the streams."""
    return heapq.merge(*streams, key=lambda message: message.header.arrival_time_ns)
