"""Where received messages wait: one queue, with each topic's delivery class, and what was lost.

Transport-free: the Zenoh bus and the in-process one both fill an :class:`Inbox`.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rsenf.bus.delivery import Delivery
from rsenf.bus.keys import TOPICS, topic_of
from rsenf.errors import SchemaMismatch
from rsenf.messages import Header, class_for, decode


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
    """

    key: str
    encoding: str
    payload: bytes
    sender: str
    droppable: bool = False


@dataclass(frozen=True)
class Received:
    """A message that was accepted, with the bytes it came in."""

    key: str
    message: Any
    payload: bytes


@dataclass
class Counters:
    """What happened to the messages of one inbox.

    Attributes
    ----------
    received : int
        Accepted and handed out.
    dropped : int
        Dropped here, by the rules of their delivery class.
    missed : int
        Never came, by sequence number, without being dropped here.
    rejected : int
        Foreign, broken, or of another version.
    duplicates : int
        Came twice, as history and live.
    """

    received: int = 0
    dropped: int = 0
    missed: int = 0
    rejected: int = 0
    duplicates: int = 0


class Inbox:
    """Thread-safe queue of envelopes that knows delivery classes and sequence numbers.

    A lossless topic makes its sender wait while its share of the queue is full; any other drops
    its oldest. Sequence numbers are checked when messages are taken out: what the history brought
    twice is dropped, what never came is counted.
    """

    def __init__(self) -> None:
        self.counters = Counters()
        self._items: deque[Envelope] = deque()
        self._waiting: Counter[str] = Counter()
        self._dropped: Counter[tuple[str, str]] = Counter()
        self._last: dict[tuple[str, str], tuple[str, int, int]] = {}
        self._closed = False
        self._change = threading.Condition()

    def put(self, item: Envelope, delivery: Delivery) -> None:
        """Add an envelope, by the rules of its delivery class. Called by the transport."""
        with self._change:
            while self._waiting[item.key] >= delivery.queue and not self._closed:
                if item.droppable or not delivery.lossless:
                    self._drop_oldest(item.key)
                else:
                    self._change.wait()
            self._add(item)

    def put_all(self, items: Iterable[Envelope]) -> None:
        """Add envelopes, however many wait: whoever asks for a history isn't reading yet."""
        for item in items:
            with self._change:
                self._add(item)

    def _add(self, item: Envelope) -> None:
        if not self._closed:
            self._items.append(item)
            self._waiting[item.key] += 1
            self._change.notify_all()

    def _drop_oldest(self, key: str) -> None:
        oldest = next(item for item in self._items if item.key == key)
        self._items.remove(oldest)
        self._waiting[key] -= 1
        self._dropped[key, oldest.sender] += 1
        self.counters.dropped += 1

    def receive(self, timeout_s: float) -> Received | None:
        """Return the next acceptable message, or None when none came in time or all is closed."""
        deadline = time.monotonic() + timeout_s
        while True:
            item = self._next(deadline)
            if item is None:
                return None
            received = self._accept(item)
            if received is not None:
                return received

    def _next(self, deadline: float) -> Envelope | None:
        with self._change:
            while not self._items:
                left = deadline - time.monotonic()
                if left <= 0 or self._closed:
                    return None
                self._change.wait(left)
            item = self._items.popleft()
            self._waiting[item.key] -= 1
            self._change.notify_all()
            return item

    def _accept(self, item: Envelope) -> Received | None:
        """Decode and check the sequence; None for what is foreign, broken or already seen."""
        message = _opened(item)
        if message is None:
            self.counters.rejected += 1
            return None
        with self._change:
            follows = self._follows((item.key, item.sender), message.header)
        if not follows:
            self.counters.duplicates += 1
            return None
        self.counters.received += 1
        return Received(item.key, message, item.payload)

    def _follows(self, stream: tuple[str, str], header: Header) -> bool:
        """Count what is missing before a message; False when it came before."""
        last, place = self._last.get(stream), (header.run_id, header.epoch, header.seq)
        if last is not None and last[:2] == place[:2]:
            absent = header.seq - last[2] - 1
            if absent < 0:
                return False
            dropped = min(absent, self._dropped[stream])
            self._dropped[stream] -= dropped
            self.counters.missed += absent - dropped
        else:
            self._dropped.pop(stream, None)
        self._last[stream] = place
        return True

    @property
    def depth(self) -> int:
        """Messages waiting."""
        return len(self._items)

    @property
    def closed(self) -> bool:
        """Whether the bus has let go of it."""
        return self._closed

    def close(self) -> None:
        """Let go of whoever waits."""
        with self._change:
            self._closed = True
            self._change.notify_all()


def _opened(item: Envelope) -> Any:
    """Return the message in an envelope; None when it isn't what its topic carries."""
    try:
        cls = class_for(item.encoding)
        message = decode(cls, item.payload)
    except SchemaMismatch:
        return None
    fits = TOPICS.get(topic_of(item.key), cls) is cls
    return message if fits and getattr(message, "header", None) is not None else None
