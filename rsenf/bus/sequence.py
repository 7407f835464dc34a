"""A message as it travels, and what of each stream has come, by its numbers."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from rsenf.messages import Header


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
        self._newest: dict[str, str] = {}
        self._dropped: Counter[tuple[str, str]] = Counter()

    def newest(self, key: str) -> str:
        """Place of the last message of a key; empty before the first."""
        return self._newest.get(key, "")

    def absent(self, item: Envelope, header: Header) -> int:
        """Messages missing before this one; below 0 when it has come already."""
        last = self._last.get((item.key, item.sender))
        if last is None or last.run_id != header.run_id:
            return 0
        if header.epoch < last.epoch:
            return -1
        return header.seq - (last.seq if header.epoch == last.epoch else -1) - 1

    def begins_epoch(self, item: Envelope, header: Header) -> bool:
        """Whether it is of a new epoch: where the one before ended, its numbers don't tell."""
        last = self._last.get((item.key, item.sender))
        return last is not None and last.run_id == header.run_id and last.epoch < header.epoch

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
        self._last[stream] = header
        self._newest[item.key] = place_of(item.sender, header)
        return absent - dropped
