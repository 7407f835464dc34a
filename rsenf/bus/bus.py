"""The interface of a bus, and the part common to all transports: history and batching.

A publisher may batch several messages of one key in one envelope. Each is preceded by its length as
a varint: the length-delimited form that the Protobuf libraries of all languages read and write. The
envelope's encoding differs, so that a batch can't be mistaken for a single message.
"""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Protocol

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import Delivery
from rsenf.bus.sequence import Envelope, place_of
from rsenf.messages import encode, encoding_of
from rsenf.messages.codec import MEDIA_TYPE

SEVERAL = "application/x-protobuf-delimited"
MOST = 64
MOST_LENGTH_BYTES = 5


def joined(items: Sequence[Envelope]) -> Envelope:
    """Batch envelopes of one key, encoding and sender in one; a single one stays unchanged."""
    if len(items) == 1:
        return items[0]
    payload = b"".join(part for item in items for part in (_length(item.payload), item.payload))
    encoding = items[0].encoding.replace(MEDIA_TYPE, SEVERAL, 1)
    return replace(items[0], encoding=encoding, payload=payload)


def apart(item: Envelope) -> list[Envelope]:
    """Split a batch into its envelopes; a single or malformed one is returned unchanged."""
    media, _, schema = item.encoding.partition(";")
    payloads = _split(item.payload) if media == SEVERAL else None
    if payloads is None:
        return [item]
    encoding = f"{MEDIA_TYPE};{schema}"
    return [replace(item, encoding=encoding, payload=payload) for payload in payloads]


def _length(payload: bytes) -> bytes:
    """Length of a message as a varint: seven bits a byte, least significant first."""
    out, rest = bytearray(), len(payload)
    while rest > 0x7F:
        out.append(rest & 0x7F | 0x80)
        rest >>= 7
    out.append(rest)
    return bytes(out)


def _split(payload: bytes) -> list[bytes] | None:
    """Split by the lengths; None if they don't add up, or there are more than MOST messages."""
    found: list[bytes] = []
    at = 0
    while at < len(payload):
        length = 0
        for place in range(MOST_LENGTH_BYTES):
            if at == len(payload):
                return None
            byte = payload[at]
            at += 1
            length |= (byte & 0x7F) << 7 * place
            if byte < 0x80:
                break
        if at + length > len(payload) or len(found) == MOST:
            return None
        found.append(payload[at : at + length])
        at += length
    return found or None


# A publisher keeps a few minutes of messages, but no more than this: rows of 1080p are 0.26 MB/s.
KEPT_BYTES = 32 * 2**20
# Largest batch. Batching pays where latency doesn't matter: waking all threads on the way takes
# longer than the work on one message.
TOGETHER_BYTES = 2**18


class Publisher(ABC):
    """Sends the messages of one key, and keeps the latest for late joiners and for recovery.

    Parameters
    ----------
    key : str
    delivery : Delivery
        Delivery class of the topic.
    sender : str
        Identity of this process on the bus.

    Attributes
    ----------
    pending : int
        1 while a message waits to be sent, held up by backpressure; else 0.
    run_suffix : str
        Appended to the run identity of each message. A restarted process numbers its messages from
        0 again, and they must not be taken for the earlier ones.
    goes_on : callable
        Whether the stream is continued by another process: END marks aren't sent.
    """

    def __init__(self, key: str, delivery: Delivery, sender: str) -> None:
        self.sent = self.pending = 0
        self.run_suffix = ""
        self.goes_on: Callable[[], bool] = lambda: False
        self.key, self.delivery, self.sender = key, delivery, sender
        self._kept: deque[tuple[str, Envelope]] = deque(maxlen=max(delivery.kept, delivery.history))
        self._kept_bytes = 0
        self._lock = threading.Lock()
        self._together: list[Envelope] = []  # not sent yet
        self._together_bytes, self._together_since_s = 0, 0.0
        self._gathered_s = math.inf  # time of the last one; the first follows no pause

    def send(self, message: Any, *, more: bool = False) -> None:
        """Send a message; blocks on slow receivers if the topic is lossless (backpressure).

        Parameters
        ----------
        message : message
        more : bool
            Whether more messages follow, so that this one may wait to be batched with them. It
            doesn't wait if they come more slowly than ``delivery.together_s``. Requires that one
            thread sends, and that it calls :meth:`flush` at the end.
        """
        if message.header.is_end and self.goes_on():
            self.flush()
            return
        if self.run_suffix:
            run_id = message.header.run_id + self.run_suffix
            message = replace(message, header=replace(message.header, run_id=run_id))
        item = Envelope(
            self.key,
            encoding_of(type(message)),
            encode(message),
            self.sender,
            droppable=not self.delivery.lossless,
            kept=self.keeps,
        )
        if self.keeps:
            with self._lock:
                self._keep(place_of(self.sender, message.header), item)
        self.sent += 1
        if more or self._together:
            self._gather(item, more=more)
        else:
            self._pass_on(item)

    def _gather(self, item: Envelope, *, more: bool) -> None:
        now_s, longest_s = time.monotonic(), self.delivery.together_s
        pause_s, self._gathered_s = now_s - self._gathered_s, now_s
        if not self._together:
            self._together_since_s = now_s
        self._together.append(item)
        self._together_bytes += len(item.payload)
        full = self._together_bytes >= TOGETHER_BYTES or len(self._together) == MOST
        late = max(pause_s, now_s - self._together_since_s) >= longest_s
        if full or late or not more:
            self.flush()

    def flush(self) -> None:
        """Send the batch that has been collected."""
        if self._together:
            items, self._together, self._together_bytes = self._together, [], 0
            self._pass_on(joined(items))

    def _pass_on(self, item: Envelope) -> None:
        self.pending = 1
        self._put(item)
        self.pending = 0

    @property
    def keeps(self) -> bool:
        """Whether it keeps messages for late joiners and for recovery."""
        return self._kept.maxlen != 0

    def _keep(self, place: str, item: Envelope) -> None:
        if len(self._kept) == self._kept.maxlen:
            self._forget_oldest()
        self._kept.append((place, item))
        self._kept_bytes += len(item.payload)
        while self._kept_bytes > KEPT_BYTES and len(self._kept) > 1:
            self._forget_oldest()

    def _forget_oldest(self) -> None:
        self._kept_bytes -= len(self._kept.popleft()[1].payload)

    def history(self) -> list[Envelope]:
        """Messages for a late joiner, oldest first."""
        with self._lock:
            items = [item for _, item in self._kept]
        return items[-self.delivery.history :] if self.delivery.history else []

    def between(self, after: str, before: str) -> list[Envelope]:
        """Return the kept messages between two places in the stream, oldest first.

        Parameters
        ----------
        after : str
            Place of the last message received before the gap. If it is no longer kept, or is
            another sender's, all kept messages count as later.
        before : str
            Place of the first message received after the gap; empty for none. If it is no longer
            kept, neither is any message before it.
        """
        with self._lock:
            kept = list(self._kept)
        places = [place for place, _ in kept]
        first = places.index(after) + 1 if after in places else 0
        last = len(kept) if not before else places.index(before) if before in places else 0
        return [item for _, item in kept[first:last]]

    @property
    @abstractmethod
    def is_heard(self) -> bool:
        """Whether the key has a subscriber."""

    @abstractmethod
    def _put(self, item: Envelope) -> None:
        """Pass an envelope to the transport."""


class Subscription:
    """One key expression of an inbox: holds live messages back until the history has arrived."""

    def __init__(self, inbox: Inbox, delivery: Delivery) -> None:
        self._inbox, self._delivery = inbox, delivery
        self._held: list[Envelope] | None = []
        self._lock = threading.Lock()

    def take(self, item: Envelope) -> None:
        """Take live messages. Called by the transport; may block it."""
        items = apart(self._for_me(item))
        with self._lock:
            if self._held is not None:
                self._held += items
                return
        for item in items:
            self._inbox.put(item, self._delivery)

    def _for_me(self, item: Envelope) -> Envelope:
        """Mark an envelope as not recoverable if this subscriber doesn't recover messages."""
        return item if self._delivery.recovers else replace(item, kept=False)

    def deliver_history(self, history: Iterable[Envelope]) -> None:
        """Take the history, then the live messages held back meanwhile."""
        self._inbox.put_all(map(self._for_me, history))
        # Under the lock, so that no newer message overtakes those held back.
        with self._lock:
            held, self._held = self._held, None
            self._inbox.put_all(held or [])


class Bus(Protocol):
    """Interface of a bus, as nodes use it."""

    def publisher(self, key: str, delivery: Delivery) -> Publisher:
        """Open a key for sending."""
        ...

    def subscribe(self, inbox: Inbox, key_expr: str, delivery: Delivery) -> None:
        """Subscribe an inbox to a key expression: history first, then live messages."""
        ...

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token that lasts as long as this process."""
        ...

    def watch_alive(self, key_expr: str, on_change: Callable[[str, bool], None]) -> None:
        """Call ``on_change(key, alive)`` for every token, including those already declared."""
        ...
