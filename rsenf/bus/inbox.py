"""The receive queue: delivery classes, sequence checks, recovery of missed messages, counters.

Independent of the transport: both the Zenoh bus and the tests' loopback fill an :class:`Inbox`.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rsenf.bus.keys import CARRIED, Delivery, topic_of
from rsenf.bus.sequence import MOST_ABSENT, Envelope, SequenceCheck, place_of
from rsenf.errors import SchemaMismatch
from rsenf.messages import EnfEstimate, Header, Health, RowBlock, class_for, decode
from rsenf.messages.plausible import implausible

# A luma plane of 8K is 33 MB; all other messages are far smaller.
LARGEST_BYTES = 64 * 2**20
# Pause before each attempt to request missed messages, until the sender answers: after a broken
# link it may take a moment to become reachable.
PAUSES_S = (0.0, 0.2, 0.6, 1.2, 2.0)
Ask = Callable[[str, str, str], Iterable[Envelope] | None]


@dataclass(frozen=True)
class Received:
    """An accepted message, with its serialised form."""

    key: str
    message: Any
    payload: bytes


@dataclass
class Counters:
    """Message counts of one inbox.

    Attributes
    ----------
    received : int
        Accepted and returned by :meth:`Inbox.receive`.
    dropped : int
        Dropped here, by the rules of their delivery class.
    missed : int
        Never arrived, by sequence number, and were not dropped here.
    rejected : int
        Malformed, too large, of another version, implausible, or of a run whose stream it isn't.
    duplicates : int
        Arrived twice, as history and live.
    recovered : int
        Requested from their sender afterwards.
    uncovered : Counter of str
        Frames, by key, of which no rows or estimates came, as a node was restarted.
    """

    received: int = 0
    dropped: int = 0
    missed: int = 0
    rejected: int = 0
    duplicates: int = 0
    recovered: int = 0
    uncovered: Counter[str] = field(default_factory=Counter)


class Inbox:
    """Thread-safe queue of envelopes that knows delivery classes and sequence numbers.

    A lossless topic blocks its sender while its share of the queue is full (backpressure); any
    other drops its oldest message. Sequence numbers are checked when messages are taken out:
    duplicates are dropped, and missing messages are requested if their sender keeps them, while
    later messages of the key are held back. Messages that never arrive are counted.

    Parameters
    ----------
    largest_bytes : int
        Size of the largest message accepted.

    Attributes
    ----------
    ask : callable
        ``ask(key, after, before)`` returns the kept messages of a key between two places, or None
        when no sender answers; set by the bus.
    whole : bool
        Whether its reader was there when the streams began.
    restarted : bool
        Whether its reader was restarted, and needs all that the senders have kept.
    """

    def __init__(self, largest_bytes: int = LARGEST_BYTES) -> None:
        self._largest_bytes = largest_bytes
        self.counters = Counters()
        self._items: deque[Envelope] = deque()
        self._waiting: Counter[str] = Counter()
        self._sequence = SequenceCheck()
        self._held: dict[str, list[Envelope]] = {}  # messages held back, by key under recovery
        self._again: set[str] = set()  # keys under recovery that need another one
        self.ask: Ask = lambda *question: None
        self.whole = self.restarted = False
        self._closed = False
        self._change = threading.Condition()

    def put(self, item: Envelope, delivery: Delivery) -> None:
        """Add an envelope by the rules of its delivery class; may block. For the transport."""
        with self._change:
            if self._is_too_large(item):
                return
            while self._waiting[item.key] >= delivery.queue and not self._closed:
                if item.droppable or not delivery.lossless:
                    self._drop_oldest(item.key)
                else:
                    self._change.wait()
            self._add(item)

    def put_all(self, items: Iterable[Envelope]) -> None:
        """Add envelopes of a history, which take no room in the queue: no sender waits for it."""
        for item in items:
            with self._change:
                if not self._is_too_large(item):
                    self._add(replace(item, stored=True))

    def _is_too_large(self, item: Envelope) -> bool:
        """Count and refuse an oversized message before it is stored."""
        too_large = len(item.payload) > self._largest_bytes
        self.counters.rejected += too_large
        return too_large

    def _add(self, item: Envelope) -> None:
        if not self._closed:
            self._items.append(item)
            self._waiting[item.key] += not item.stored
            self._change.notify_all()

    def _drop_oldest(self, key: str) -> None:
        oldest = next(item for item in self._items if item.key == key and not item.stored)
        self._items.remove(oldest)
        self._waiting[key] -= 1
        self._sequence.dropped(oldest)
        self.counters.dropped += 1

    def receive(self, timeout_s: float) -> Received | None:
        """Return the next accepted message; None after the timeout (s) or when closed."""
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
            while True:
                while not self._items:
                    remaining_s = deadline - time.monotonic()
                    if remaining_s <= 0 or self._closed:
                        return None
                    self._change.wait(remaining_s)
                item = self._items.popleft()
                self._waiting[item.key] -= not item.stored
                self._change.notify_all()
                if item.key not in self._held:
                    return item
                self._held[item.key].append(item)

    def _accept(self, item: Envelope) -> Received | None:
        """Decode a message and check its number; None if held back, rejected or a duplicate."""
        message = _opened(item)
        if message is None:
            self.counters.rejected += 1
            return None
        with self._change:
            if item.key in self._held:
                self._held[item.key].append(item)
                return None
            header, sequence = message.header, self._sequence
            absent = sequence.absent(item, header)
            is_health = CARRIED.get(topic_of(item.key)) is Health
            foreign = not is_health and sequence.is_foreign(item, header)
            if foreign or absent > MOST_ABSENT:
                self.counters.rejected += 1
                return None
            if absent < 0:
                self.counters.duplicates += 1
                return None
            if item.kept and not item.late and (absent or sequence.begins_epoch(item, header)):
                self._held[item.key] = [replace(item, kept=False)]  # no second recovery
                self._recover(item.key, place_of(item.sender, header))
                return None
            self.counters.missed += sequence.took(item, header)
            if isinstance(message, (RowBlock, EnfEstimate)):
                blocks, frames = sequence.uncovered(item.key, header, whole=self.whole)
                self.counters.missed += blocks
                self.counters.uncovered[item.key] += frames
            self.counters.received += 1
            self.counters.recovered += item.late
        return Received(item.key, message, item.payload)

    def resume(self, last: Mapping[str, Header]) -> None:
        """Count what is missing after the last messages that a restarted reader had taken.

        Of nodes' health, nothing is kept, so nothing counts.
        """
        kept = {key: h for key, h in last.items() if CARRIED.get(topic_of(key)) is not Health}
        self._sequence.resume(kept)

    def recover_tail(self, key: str) -> None:
        """Request what may be missing after the last message of a key: its sender is back."""
        with self._change:
            if key in self._held:
                self._again.add(key)
            else:
                self._held[key] = []
                self._recover(key, "")

    def _recover(self, key: str, before: str) -> None:
        """Request missing messages in a thread, while the reader goes on with other keys."""
        after = self._sequence.newest(key)

        def work() -> None:
            missing: list[Envelope] = []
            for pause_s in PAUSES_S:
                time.sleep(pause_s)
                answer = self.ask(key, after, before)
                if answer is not None or self._closed:
                    missing = [replace(item, late=True, stored=True) for item in answer or ()]
                    break
            with self._change:
                missing = [item for item in missing if not self._is_too_large(item)]
                back = [*missing, *self._held.pop(key)]
                self._items.extendleft(reversed(back))
                self._waiting[key] += sum(not item.stored for item in back)
                self._change.notify_all()
                if key in self._again:
                    self._again.discard(key)
                    self.recover_tail(key)

        threading.Thread(target=work, name="recovery", daemon=True).start()

    @property
    def depth(self) -> int:
        """Number of messages queued or held back, plus pending recoveries."""
        with self._change:
            return len(self._items) + sum(1 + len(held) for held in self._held.values())

    def close(self) -> None:
        """Close the inbox and release all waiting threads."""
        with self._change:
            self._closed = True
            self._change.notify_all()


class CallbackInbox(Inbox):
    """Passes each accepted message to a callback at once, in the transport's thread.

    For fast observers only: the callback blocks the transport.

    Parameters
    ----------
    tell : callable
        Takes a :class:`Received`.
    """

    def __init__(self, tell: Callable[[Received], None]) -> None:
        super().__init__()
        self._tell = tell

    def _add(self, item: Envelope) -> None:
        received = self._accept(item)
        if received is not None:
            self._tell(received)


def _opened(item: Envelope) -> Any:
    """Return the message in an envelope; None if malformed, implausible or wrong for the topic."""
    try:
        cls = class_for(item.encoding)
        message = decode(cls, item.payload)
    except SchemaMismatch:
        return None
    fits = CARRIED.get(topic_of(item.key), cls) is cls
    return message if fits and not implausible(message) else None
