"""The interface of a stage: takes messages and returns messages.

A stage knows no bus, clock or configuration file. The same object is used in a node process, in a
replay and in the one-process commands, so that their results are bit-identical. A
:class:`StageSpec` has everything that is needed to run it.
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
        """Take one message.

        Parameters
        ----------
        message : message
            Of one of the topics that the stage reads.

        Returns
        -------
        list of messages
            Those that it completes, in order; often none.
        """
        ...

    def flush(self) -> list[Any]:
        """Return the messages that the end of the stream completes. No update may follow."""
        ...


@dataclass(frozen=True)
class StageSpec:
    """A stage of one camera: its inputs and outputs, and its factory.

    Attributes
    ----------
    sends : tuple of str
        Topics of its messages. If there are two, the message's class selects the topic.
    reads : tuple of str
        Topics of the same camera, and ``reference`` for a grid's.
    make : callable
        Returns a new stage. Called for every epoch, so that a stage never sees two.
    optional : tuple of str
        Topics in ``reads`` that are read only if some node sends them.
    shown : str
        Topic whose newest message is shown in the node's state, by its ``in_short``.
    silent_s : float
        Time without a message of the first topic after which the stage is notified.
    on_silence : callable, optional
        Makes that notice; takes the header of the stream, which may not have begun.
    """

    sends: tuple[str, ...]
    reads: tuple[str, ...]
    make: Callable[[], Stage]
    optional: tuple[str, ...] = ()
    shown: str = ""
    silent_s: float = math.inf
    on_silence: Callable[[Any], Any] | None = None


class StageContext:
    """The environment of a stage; by default it runs alone and without time limits.

    Attributes
    ----------
    is_shared : bool
        Whether all stages of a node get the same input, so that they may share work.
    stays : bool
        Whether it must continue after any input, as in a node that is restarted.
    refused : callable or None
        Called with the reason why an input can't be used at all; if None, that is an error.
    """

    is_shared = True
    stays = False
    refused: Callable[[str], None] | None = None

    def is_behind(self) -> bool:
        """Whether the stage is late and should skip optional work."""
        return False

    def late(self, pts_ns: int) -> None:
        """Note that an input came when the wait for it was over, by the newest rows' time.

        The output about then depends on which of the two came first.
        """

    def run(self, work: Callable[[], T]) -> T | None:
        """Run a long computation; return its result, or None if it was cancelled."""
        return work()


ALONE = StageContext()
