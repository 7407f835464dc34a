"""Missing messages of a topic, by sequence numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from rsenf.messages import Header
from rsenf.record.tally import Numbers


class Gap(NamedTuple):
    """A range of missing sequence numbers.

    Attributes
    ----------
    run_id : str
    epoch : int
    first, last : int
        Both inclusive.
    damaged : bool
        Whether the file is damaged there. Otherwise the messages were never recorded.
    """

    run_id: str
    epoch: int
    first: int
    last: int
    damaged: bool

    @property
    def messages(self) -> int:
        """Number of missing messages."""
        return self.last - self.first + 1


@dataclass
class _Stream:
    numbers: Numbers = field(default_factory=Numbers)
    last: int = -1  # highest number so far
    damages: int = 0  # damaged places of the file before its last message
    hit: list[tuple[int, int]] = field(default_factory=list)  # numbers around damage

    @property
    def begins_with_damage(self) -> bool:
        return bool(self.hit) and self.hit[0][0] < 0


@dataclass
class TopicNumbers:
    """Counts a topic's messages, taken in the order of the file.

    Attributes
    ----------
    messages, duplicates : int
    last : Header or None
        Header of the last message.
    damages : int
        Number of damaged places of the file before that one.
    """

    messages: int = 0
    duplicates: int = 0
    last: Header | None = None
    damages: int = 0
    _streams: dict[tuple[str, int], _Stream] = field(default_factory=dict)

    def take(self, header: Header, damages: int) -> None:
        """Take a message; ``damages`` is the number of damaged places of the file before it."""
        stream = self._streams.setdefault((header.run_id, header.epoch), _Stream())
        self.messages += 1
        self.duplicates += not stream.numbers.add(header.seq)
        if damages > stream.damages:
            stream.hit.append((stream.last, header.seq))
        stream.damages = damages
        stream.last = max(stream.last, header.seq)
        self.last, self.damages = header, damages

    def gaps(self, joined_at: int | None) -> list[Gap]:
        """Return what is missing between the first and the last number of each stream.

        Parameters
        ----------
        joined_at : int or None
            First number recorded of the first stream; earlier ones don't count as missing. None if
            unknown: then it is the first number found, or 0 after damage.
        """
        found = []
        for place, ((run_id, epoch), stream) in enumerate(self._streams.items()):
            start = 0 if place or stream.begins_with_damage else stream.numbers.first
            if place == 0 and joined_at is not None:
                start = joined_at
            for hole in stream.numbers.holes(start):
                damaged = any(a < hole.stop and hole.start <= b for a, b in stream.hit)
                found.append(Gap(run_id, epoch, hole.start, hole.stop - 1, damaged))
        return found
