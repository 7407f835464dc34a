"""What any bus offers, and what every bus does alike: history for those who join late."""

from __future__ import annotations

import dataclasses
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from rsenf.bus.delivery import Delivery
from rsenf.bus.inbox import Envelope, Inbox
from rsenf.messages import encode, encoding_of


class Publisher(ABC):
    """Sends the messages of one key, and keeps the last of them for those who join late.

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
        self.key, self.delivery = key, delivery
        self._sender = sender
        self._kept: deque[Envelope] = deque(maxlen=delivery.history)
        self._lock = threading.Lock()

    def send(self, message: Any) -> None:
        """Send a message; waits for slow receivers when the topic is lossless."""
        if self.run_suffix:
            message = _of_run(message, message.header.run_id + self.run_suffix)
        item = Envelope(
            self.key,
            encoding_of(type(message)),
            encode(message),
            self._sender,
            droppable=not self.delivery.lossless,
        )
        with self._lock:
            self._kept.append(item)
        self._put(item)
        self.sent += 1

    def history(self) -> list[Envelope]:
        """Messages kept, the oldest first."""
        with self._lock:
            return list(self._kept)

    @property
    @abstractmethod
    def is_heard(self) -> bool:
        """Whether anybody has subscribed to the key."""

    @abstractmethod
    def _put(self, item: Envelope) -> None:
        """Hand an envelope to the transport."""


def _of_run(message: Any, run_id: str) -> Any:
    header = dataclasses.replace(message.header, run_id=run_id)
    return dataclasses.replace(message, header=header)


class Subscription:
    """One key expression of an inbox: live messages wait until the history has come."""

    def __init__(self, inbox: Inbox, delivery: Delivery) -> None:
        self._inbox, self._delivery = inbox, delivery
        self._held: list[Envelope] | None = []
        self._lock = threading.Lock()

    def take(self, item: Envelope) -> None:
        """Take a live message. Called by the transport, which it makes wait."""
        with self._lock:
            if self._held is not None:
                self._held.append(item)
                return
        self._inbox.put(item, self._delivery)

    def catch_up(self, history: Iterable[Envelope]) -> None:
        """Take the history, then what has come meanwhile."""
        self._inbox.put_all(history)
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
