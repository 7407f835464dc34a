"""State carried over from one file to the next when a recording is split."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rsenf.record.tally import TopicTally
from rsenf.record.timeline import Timeline


@dataclass
class Continuity:
    """A common time line of all files, and the sequence numbers received.

    Parameters
    ----------
    timeline : Timeline
        Continues log times without a jump.
    tallies : dict of str to TopicTally
        By topic, for the current file.
    """

    timeline: Timeline
    tallies: dict[str, TopicTally] = field(default_factory=dict)

    @classmethod
    def beginning(cls, clock_ns: Callable[[], int]) -> Continuity:
        """Return the state before the first file."""
        return cls(Timeline(clock_ns))

    def tally(self, topic: str) -> TopicTally:
        """Return the tally of a topic."""
        return self.tallies.setdefault(topic, TopicTally())

    def next_file(self) -> Continuity:
        """Return the state for the next file."""
        following = {topic: tally.next_file() for topic, tally in self.tallies.items()}
        return Continuity(self.timeline, following)
