"""One follower for two stages of a process, which receive the same blocks one after the other.

Tracking the flicker is most of the work of a tracker and of an idle estimator, and identical in
both: the stage that receives a block first has it tracked, the other gets the cached result.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Protocol

from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.second import FlickerSecond
from rsenf.messages import RowBlock

Heard = tuple[RowBlock | None, list[FlickerSecond]]  # a block (None: end), and its seconds


class Follower(Protocol):
    """Row blocks in, one :class:`FlickerSecond` for every second of the stream out."""

    @property
    def origin_ns(self) -> int:
        """Stream clock at the first frame."""
        ...

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        """Take a block of rows; return the seconds that it completes."""
        ...

    def flush(self) -> list[FlickerSecond]:
        """Return the seconds that are left."""
        ...


def shared(follower: FlickerFollower) -> tuple[Follower, Follower]:
    """Return two readers of one follower. Both must be given the very same blocks."""
    one, other = _Reader(follower), _Reader(follower)
    one.other, other.other = other, one
    return one, other


@dataclass(eq=False)
class _Reader:
    follower: FlickerFollower
    queued: deque[Heard] = field(default_factory=deque)  # results queued by the other reader

    def __post_init__(self) -> None:
        self.other = self

    @property
    def origin_ns(self) -> int:
        return self.follower.origin_ns

    def update(self, block: RowBlock) -> list[FlickerSecond]:
        return self._next(block)

    def flush(self) -> list[FlickerSecond]:
        return self._next(None)

    def _next(self, block: RowBlock | None) -> list[FlickerSecond]:
        if not self.queued:
            seconds = self.follower.flush() if block is None else self.follower.update(block)
            self.other.queued.append((block, seconds))
            return seconds
        known, seconds = self.queued.popleft()
        if known is not block:
            raise RuntimeError("two stages that follow the flicker together were fed differently")
        return seconds
