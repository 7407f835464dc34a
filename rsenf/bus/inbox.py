"""Where received messages wait: one queue, with each topic's delivery class, and what was lost.

Transport-free: the Zenoh bus and the in-process one both fill an :class:`Inbox`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

from rsenf.bus.delivery import Delivery
from rsenf.errors import SchemaMismatch
from rsenf.messages import class_for, decode


@dataclass(frozen=True)
class Envelope:
    """A message as it travels: its key, what it is said to be, its bytes, and which sender."""

    key: str
    encoding: str
    payload: bytes
    sender: str


@dataclass(frozen=True)
class Received:
    """A message that was accepted, with the bytes it came in."""

    key: str
    message: Any
    payload: bytes


@dataclass
class Counters:
    """What happened to the messages of one inbox."""

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
        self._waiting: dict[str, int] = {}
        self._last: dict[tuple[str, str], tuple[str, int, int]] = {}
        self._closed = False
        self._change = threading.Condition()

    def put(self, item: Envelope, delivery: Delivery) -> None:
        """Add an envelope, by the rules of its delivery class. Called by the transport."""
        with self._change:
            while self._waiting.get(item.key, 0) >= delivery.queue and not self._closed:
                if not delivery.lossless:
                    self._drop_oldest(item.key)
                    break
                self._change.wait(0.5)
            if self._closed:
                return
            self._items.append(item)
            self._waiting[item.key] = self._waiting.get(item.key, 0) + 1
            self._change.notify_all()

    def _drop_oldest(self, key: str) -> None:
        for i, item in enumerate(self._items):
            if item.key == key:
                del self._items[i]
                self._waiting[key] -= 1
                self.counters.dropped += 1
                return

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
        try:
            message = decode(class_for(item.encoding), item.payload)
        except SchemaMismatch:
            self.counters.rejected += 1
            return None
        header = message.header
        if header is None:
            self.counters.rejected += 1
            return None
        stream, place = (item.key, item.sender), (header.run_id, header.epoch, header.seq)
        last = self._last.get(stream)
        if last is not None and last[:2] == place[:2]:
            if header.seq <= last[2]:
                self.counters.duplicates += 1
                return None
            self.counters.missed += header.seq - last[2] - 1
        self._last[stream] = place
        self.counters.received += 1
        return Received(item.key, message, item.payload)

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
