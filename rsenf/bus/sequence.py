"""A message as it travels, and what of each stream has come, by its numbers."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

from rsenf.messages import Header

# Runs that a stream has left, and that are known again: more than any sender keeps messages of.
MOST_LEFT = 64


@dataclass(frozen=True)
class Envelope:
    """A message as it travels.

    Parameters
    ----------
    key : str
        Where it was sent to.
    encoding : str
        What it is said to be.
    payload : bytes
        The message.
    sender : str
        Session that sent it: one sender's numbers say nothing about another's.
    droppable : bool
        Whether the sender rather lost it than waited.
    kept : bool
        Whether the sender keeps its messages for a while, for who misses one.
    late : bool
        Whether it was got from what the sender kept.
    """

    key: str
    encoding: str
    payload: bytes
    sender: str
    droppable: bool = False
    kept: bool = False
    late: bool = False


def place_of(sender: str, header: Header) -> str:
    """A message's place in all that its sender sends of a topic."""
    return f"{sender}:{header.run_id}:{header.epoch}:{header.seq}"


class Sequence:
    """What has come of every stream: the messages that one sender sends to one key."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], Header] = {}
        self._left: dict[tuple[str, str], deque[str]] = {}  # runs before the present one
        self._newest: dict[str, str] = {}
        self._dropped: Counter[tuple[str, str]] = Counter()

    def newest(self, key: str) -> str:
        """Place of the last message of a key; empty before the first."""
        return self._newest.get(key, "")

    def absent(self, item: Envelope, header: Header) -> int:
        """Messages missing before this one; below 0 when it has come already."""
        last = self._last.get((item.key, item.sender))
        if last is None:
            return 0
        if last.run_id != header.run_id:
            return -1 if header.run_id in self._left.get((item.key, item.sender), ()) else 0
        if header.epoch < last.epoch:
            return -1
        return header.seq - (last.seq if header.epoch == last.epoch else -1) - 1

    def begins_epoch(self, item: Envelope, header: Header) -> bool:
        """Whether it is of a new epoch or run: where that before ended, its numbers don't tell."""
        last = self._last.get((item.key, item.sender))
        return last is not None and (last.run_id, last.epoch) != (header.run_id, header.epoch)

    def dropped(self, item: Envelope) -> None:
        """Take in that a message was dropped here."""
        self._dropped[item.key, item.sender] += 1

    def took(self, item: Envelope, header: Header) -> int:
        """Take in a message that is handed out; returns how many before it never came."""
        stream, absent = (item.key, item.sender), self.absent(item, header)
        last = self._last.get(stream)
        dropped = min(absent, self._dropped[stream])
        if last is not None and (last.run_id, last.epoch) == (header.run_id, header.epoch):
            self._dropped[stream] -= dropped
        else:
            del self._dropped[stream]
        if last is not None and last.run_id != header.run_id:
            self._left.setdefault(stream, deque(maxlen=MOST_LEFT)).append(last.run_id)
        self._last[stream] = header
        self._newest[item.key] = place_of(item.sender, header)
        return absent - dropped
