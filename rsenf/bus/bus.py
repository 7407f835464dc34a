"""What any bus offers, and what every bus does alike: the history of what was sent.

Several messages of one key in one envelope, as a sender that runs ahead of time sends them.

Each message comes after its length as a varint: the delimited form that the Protobuf libraries of
all languages read and write. The encoding says so, so that nobody takes them for one message.
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

from rsenf.bus.delivery import Delivery
from rsenf.bus.inbox import Inbox
from rsenf.bus.sequence import Envelope, place_of
from rsenf.messages import encode, encoding_of
from rsenf.messages.codec import MEDIA_TYPE

SEVERAL = "application/x-protobuf-delimited"
MOST = 64
MOST_LENGTH_BYTES = 5


def joined(items: Sequence[Envelope]) -> Envelope:
    """Put envelopes of one key, encoding and sender into one; a single one stays as it is."""
    if len(items) == 1:
        return items[0]
    payload = b"".join(part for item in items for part in (_length(item.payload), item.payload))
    encoding = items[0].encoding.replace(MEDIA_TYPE, SEVERAL, 1)
    return replace(items[0], encoding=encoding, payload=payload)


def apart(item: Envelope) -> list[Envelope]:
    """Take an envelope apart into those that were joined; one that is broken stays as it is."""
    media, _, schema = item.encoding.partition(";")
    payloads = _split(item.payload) if media == SEVERAL else None
    if payloads is None:
        return [item]
    encoding = f"{MEDIA_TYPE};{schema}"
    return [replace(item, encoding=encoding, payload=payload) for payload in payloads]


def _length(payload: bytes) -> bytes:
    """Length of a message as a varint: seven bits a byte, the lowest first."""
    out, rest = bytearray(), len(payload)
    while rest > 0x7F:
        out.append(rest & 0x7F | 0x80)
        rest >>= 7
    out.append(rest)
    return bytes(out)


def _split(payload: bytes) -> list[bytes] | None:
    """Split at the lengths; None when they don't fill the payload, or nobody would send it."""
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


# What is kept of a topic is a few minutes, but no more memory than this: rows of 1080p are 0.26 MB
# a second.
KEPT_BYTES = 32 * 2**20
# Where nobody waits for each message, several go at once: to wake everybody on their way takes
# longer than what is done with one. So many bytes of them, or as many as come in so long.
TOGETHER_BYTES = 2**18


class Publisher(ABC):
    """Sends the messages of one key, and keeps the last of them for who was not there to hear.

    Parameters
    ----------
    key : str
        Where to.
    delivery : Delivery
        Class of the topic.
    sender : str
        Identity of this process on the bus.

    Attributes
    ----------
    run_suffix : str
        What is added to the run's identity in each message. A process that was started again
        numbers its messages anew, so they must not pass for the ones before.
    """

    def __init__(self, key: str, delivery: Delivery, sender: str) -> None:
        self.sent = 0
        self.run_suffix = ""
        self.key, self.delivery, self.sender = key, delivery, sender
        self._kept: deque[tuple[str, Envelope]] = deque(maxlen=max(delivery.kept, delivery.history))
        self._kept_bytes = 0
        self._lock = threading.Lock()
        self._together: list[Envelope] = []  # not sent yet
        self._together_bytes, self._together_since_s = 0, 0.0
        self._gathered_s = math.inf  # when the last was: before the first there is no pause

    def send(self, message: Any, *, more: bool = False) -> None:
        """Send a message; waits for slow receivers when the topic is lossless.

        Parameters
        ----------
        message : message
            What is sent.
        more : bool
            Whether others follow, so that it may wait for them and go with them; not where they
            come so slowly that it would wait in vain. Only for who sends from one thread, and
            flushes at the end.
        """
        if self.run_suffix:
            message = _of_run(message, message.header.run_id + self.run_suffix)
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
            self._put(item)

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
        """Send what still waits for others to go with it."""
        if self._together:
            items, self._together, self._together_bytes = self._together, [], 0
            self._put(joined(items))

    @property
    def keeps(self) -> bool:
        """Whether it answers those who missed something."""
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
        """Messages for who joins late, the oldest first."""
        with self._lock:
            items = [item for _, item in self._kept]
        return items[-self.delivery.history :] if self.delivery.history else []

    def between(self, after: str, before: str) -> list[Envelope]:
        """Messages kept of those between two places in the stream, the oldest first.

        Parameters
        ----------
        after : str
            The last that came; what isn't kept any more, or is another sender's, is before all.
        before : str
            The first that came again; empty when none has. When it isn't kept any more, nothing
            before it is.
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
        """Whether anybody has subscribed to the key."""

    @abstractmethod
    def _put(self, item: Envelope) -> None:
        """Hand an envelope to the transport."""


def _of_run(message: Any, run_id: str) -> Any:
    return replace(message, header=replace(message.header, run_id=run_id))


class Subscription:
    """One key expression of an inbox: live messages wait until the history has come."""

    def __init__(self, inbox: Inbox, delivery: Delivery) -> None:
        self._inbox, self._delivery = inbox, delivery
        self._held: list[Envelope] | None = []
        self._lock = threading.Lock()

    def take(self, item: Envelope) -> None:
        """Take live messages. Called by the transport, which it makes wait."""
        items = apart(self._for_me(item))
        with self._lock:
            if self._held is not None:
                self._held += items
                return
        for item in items:
            self._inbox.put(item, self._delivery)

    def _for_me(self, item: Envelope) -> Envelope:
        """Who only looks doesn't ask for what it missed."""
        return item if self._delivery.recovers else replace(item, kept=False)

    def catch_up(self, history: Iterable[Envelope]) -> None:
        """Take the history, then what has come meanwhile."""
        self._inbox.put_all(map(self._for_me, history))
        # Under the lock, so that no newer message can overtake those held.
        with self._lock:
            held, self._held = self._held, None
            self._inbox.put_all(held or [])


class Bus(Protocol):
    """What a node needs of a bus."""

    def publisher(self, key: str, delivery: Delivery) -> Publisher:
        """Open a key for sending."""
        ...

    def subscribe(self, inbox: Inbox, key_expr: str, delivery: Delivery) -> None:
        """Let an inbox receive a key expression, its history included, in order."""
        ...

    def declare_alive(self, key: str) -> None:
        """Show a liveliness token for as long as this process lives."""
        ...

    def watch_alive(self, key_expr: str, on_change: Callable[[str, bool], None]) -> None:
        """Call ``on_change(key, alive)`` for every token, those already there included."""
        ...
