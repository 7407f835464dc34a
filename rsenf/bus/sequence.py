"""Envelopes of messages, and the sequence numbers received of each stream."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass

from rsenf.messages import Header

# Earlier runs remembered for each stream: more than any sender keeps messages of.
MOST_LEFT = 64


@dataclass(frozen=True)
class Envelope:
    """A serialised message in transit.

    Parameters
    ----------
    key : str
        Destination.
    encoding : str
        Media type and schema, as declared by the sender.
    payload : bytes
    sender : str
        Session that sent it; each sender numbers its messages independently.
    droppable : bool
        Whether the sender prefers loss to blocking.
    kept : bool
        Whether the sender keeps its messages for a while, for recovery.
    late : bool
        Whether it was recovered from the sender's kept messages.
    """

    key: str
    encoding: str
    payload: bytes
    sender: str
    droppable: bool = False
    kept: bool = False
    late: bool = False


def place_of(sender: str, header: Header) -> str:
    """Identify a message's place in its sender's stream, by sender, run, epoch and number."""
    return f"{sender}:{header.run_id}:{header.epoch}:{header.seq}"


class Sequence:
    """Tracks the sequence numbers of every stream: the messages of one sender to one key."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], Header] = {}
        self._left: dict[tuple[str, str], deque[str]] = {}  # runs before the present one
        self._newest: dict[str, str] = {}
        self._dropped: Counter[tuple[str, str]] = Counter()

    def newest(self, key: str) -> str:
        """Return the place of the last message of a key; empty before the first."""
        return self._newest.get(key, "")

    def absent(self, item: Envelope, header: Header) -> int:
        """Return how many messages are missing before this one; negative for a duplicate."""
        last = self._last.get((item.key, item.sender))
        if last is None:
            return 0
        if last.run_id != header.run_id:
            return -1 if header.run_id in self._left.get((item.key, item.sender), ()) else 0
        if header.epoch < last.epoch:
            return -1
        return header.seq - (last.seq if header.epoch == last.epoch else -1) - 1

    def begins_epoch(self, item: Envelope, header: Header) -> bool:
        """Whether it begins a new epoch or run. The numbers can't tell where the last one ended."""
        last = self._last.get((item.key, item.sender))
        return last is not None and (last.run_id, last.epoch) != (header.run_id, header.epoch)

    def dropped(self, item: Envelope) -> None:
        """Note that the inbox has dropped a message."""
        self._dropped[item.key, item.sender] += 1

    def took(self, item: Envelope, header: Header) -> int:
        """Note a message that is passed to the reader; return how many before it were missed."""
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
