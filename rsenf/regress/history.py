"""Recovers what stages got besides messages, from their recorded outputs.

Two things are in no message that a stage receives: which frames of a live camera reached the rows
stage (its blocks name them), and when the discovery watch had no time for a verdict (the next
verdict counts those skipped).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from rsenf.messages import DiscoveryVerdict, Header, RowBlock
from rsenf.record import Recording
from rsenf.stage import StageContext

T = TypeVar("T")

Run = tuple[str, int]  # run and epoch


def run_of(header: Header) -> Run:
    """Return the run and epoch of a message, to which its numbers and times are relative."""
    return header.run_id, header.epoch


class RecordedContext(StageContext):
    """The environment of a stage when it was recorded: which verdicts it skipped or gave up.

    Parameters
    ----------
    skipped : list of int or None
        Number of verdicts skipped before each one; None if the stage skips none.
    stays : bool
        Whether its node had to continue after any input.
    """

    is_shared = False  # each stage is run alone

    def __init__(self, skipped: list[int] | None, *, stays: bool) -> None:
        self._left = None if skipped is None else list(skipped)
        self.stays = stays

    def refused(self, why: str) -> None:
        """Ignore the reason: a node that stays reports it only in its state."""

    def is_behind(self) -> bool:
        """Whether the verdict that is due was skipped."""
        if not self._left or not self._left[0]:
            return False
        self._left[0] -= 1
        return True

    def run(self, work: Callable[[], T]) -> T | None:
        """Do the work, unless it was given up because the graph was stopped."""
        if self._left is None:
            return work()
        if not self._left:
            return None
        self._left.pop(0)
        return work()


@dataclass
class History:
    """What a recording contains besides its messages' content.

    Attributes
    ----------
    frames : dict
        Number of each frame that reached a rows stage, by topic, run, and time in ns.
    skipped : dict
        Number of verdicts skipped before each recorded one, by topic.
    """

    frames: dict[str, dict[Run, dict[int, int]]] = field(default_factory=dict)
    skipped: dict[str, list[int]] = field(default_factory=dict)

    def context(self, topic: str, *, stays: bool) -> RecordedContext:
        """Return the environment of the stage that sends a topic."""
        return RecordedContext(self.skipped.get(topic), stays=stays)


def history_of(recording: Recording, topics: list[str]) -> History:
    """Collect it from the row blocks and verdicts among some topics."""
    out = History()
    told = [t for t in topics if t in recording.topics and t.endswith(("/rows", "/discover"))]
    for topic, message, _ in recording.messages(told, tolerant=True) if told else ():
        if message.header.is_end:
            continue
        if isinstance(message, RowBlock):
            numbers = out.frames.setdefault(topic, {}).setdefault(run_of(message.header), {})
            times = message.frame_pts_ns.tolist()
            numbers.update(zip(times, message.frame_number.tolist(), strict=True))
        elif isinstance(message, DiscoveryVerdict):
            out.skipped.setdefault(topic, []).append(message.windows_skipped)
    return out
