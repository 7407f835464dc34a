"""What goes on from one file to the next, when a recording is spread over several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from rsenf.record.tally import TopicTally
from rsenf.record.timeline import Timeline


@dataclass
class Continuity:
    """One time line for all files, and which numbers have come.

    Parameters
    ----------
    timeline : Timeline
        Log times go on without a jump.
    tallies : dict of str to TopicTally
        Of each topic, for the file in the making.
    """

    timeline: Timeline
    tallies: dict[str, TopicTally] = field(default_factory=dict)

    @classmethod
    def beginning(cls, clock_ns: Callable[[], int]) -> Continuity:
        """Nothing has been recorded yet."""
        return cls(Timeline(clock_ns))

    def tally(self, topic: str) -> TopicTally:
        """Tally of a topic."""
        return self.tallies.setdefault(topic, TopicTally())

    def next_file(self) -> Continuity:
        """Return what a file that follows begins with."""
        following = {topic: tally.next_file() for topic, tally in self.tallies.items()}
        return Continuity(self.timeline, following)
