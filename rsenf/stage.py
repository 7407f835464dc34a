"""What a stage is: messages in, messages out, and nothing else.

A stage knows no bus, no clock, no configuration file. The same object serves a node process, a
replay and the one-process commands, so that they can't differ by a bit. A :class:`StageSpec` says
all that these need to know to run it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

T = TypeVar("T")


class Stage(Protocol):
    """One step of the pipeline."""

    def update(self, message: Any) -> list[Any]:
        """Take one message; return those that it completed, in order."""
        ...

    def flush(self) -> list[Any]:
        """Return what the end of the stream completes. Nothing may follow."""
        ...


@dataclass(frozen=True)
class StageSpec:
    """A stage of one camera: what it reads, what it sends, how it is made.

    Attributes
    ----------
    sends : tuple of str
        Topics of its messages. With two, a message's class tells which it goes to.
    reads : tuple of str
        Topics of the same camera, and ``reference`` for a grid's.
    make : callable
        Builds a fresh stage. Called for every epoch, so that none mixes two.
    optional : tuple of str
        Of those that it reads: read only where they are sent.
    shown : str
        Topic whose newest message is told in the node's state, by its ``in_short``.
    silent_s : float
        The stage is told when nothing of the first topic has come for so long.
    on_silence : callable, optional
        From the header of a stream that may not have begun to the message that tells it.
    """

    sends: tuple[str, ...]
    reads: tuple[str, ...]
    make: Callable[[], Stage]
    optional: tuple[str, ...] = ()
    shown: str = ""
    silent_s: float = math.inf
    on_silence: Callable[[Any], Any] | None = None


class StageContext:
    """What a stage is given beside messages; by default it runs alone, with all the time it needs.

    Attributes
    ----------
    is_shared : bool
        Whether all stages of a node are fed the same, so that they may share work.
    stays : bool
        Whether it is to go on whatever comes, as a node that is started again does.
    refused : callable or None
        Told why an input can't be used at all; without, that is an error.
    """

    is_shared = True
    stays = False
    refused: Callable[[str], None] | None = None

    def is_behind(self) -> bool:
        """Whether to skip what is due, for there is no time."""
        return False

    def run(self, work: Callable[[], T]) -> T | None:
        """Do what takes long; None when it was given up."""
        return work()


ALONE = StageContext()
