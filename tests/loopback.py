"""An in-process bus for tests: the same interface, without sockets or delays."""

from __future__ import annotations

import threading
from collections.abc import Callable
from itertools import chain

from rsenf.bus.bus import Publisher, Subscription
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import Delivery, matches
from rsenf.bus.sequence import Envelope


class Loopback:
    """The network shared by all its buses."""

    def __init__(self) -> None:
        self.subscriptions: list[tuple[str, Subscription]] = []
        self.publishers: list[Publisher] = []
        self.tokens: list[str] = []
        self.watchers: list[tuple[str, Callable[[str, bool], None]]] = []
        self.cut_off: set[str] = set()  # buses whose link to all others is broken
        self.lock = threading.RLock()

    def bus(self, name: str) -> LoopbackBus:
        """Return a new bus on this network, as of one process."""
        return LoopbackBus(self, name)


class _LoopbackPublisher(Publisher):
    def __init__(self, network: Loopback, key: str, delivery: Delivery, sender: str) -> None:
        super().__init__(key, delivery, sender)
        self._network = network

    @property
    def is_heard(self) -> bool:
        """Whether the key has a subscriber."""
        with self._network.lock:
            return any(matches(expr, self.key) for expr, _ in self._network.subscriptions)

    def _put(self, item: Envelope) -> None:
        if self.sender in self._network.cut_off:
            return
        with self._network.lock:
            takers = [s for expr, s in self._network.subscriptions if matches(expr, item.key)]
        for subscription in takers:
            subscription.take(item)


class LoopbackBus:
    """A :class:`rsenf.bus.bus.Bus`."""

    def __init__(self, network: Loopback, name: str) -> None:
        self._network, self._name = network, name
        self._tokens: list[str] = []

    def publisher(self, key: str, delivery: Delivery) -> Publisher:
        """Open a key for sending."""
        publisher = _LoopbackPublisher(self._network, key, delivery, self._name)
        with self._network.lock:
            self._network.publishers.append(publisher)
        return publisher

    def subscribe(self, inbox: Inbox, key_expr: str, delivery: Delivery) -> None:
        """Subscribe an inbox to a key expression: history first, then live messages."""
        inbox.ask = self._ask
        subscription = Subscription(inbox, delivery)
        with self._network.lock:
            self._network.subscriptions.append((key_expr, subscription))
            senders = [p for p in self._network.publishers if matches(key_expr, p.key)]
        kept = [p.between("", "") if inbox.restarted else p.history() for p in senders]
        subscription.deliver_history(chain.from_iterable(kept if delivery.history else ()))

    def _ask(self, key: str, after: str, before: str) -> list[Envelope] | None:
        """Return the kept messages of a key between two places; None if no sender answers."""
        with self._network.lock:
            senders = [p for p in self._network.publishers if p.key == key]
        heard = [p for p in senders if p.sender not in self._network.cut_off]
        return [item for p in heard for item in p.between(after, before)] if heard else None

    def cut(self, *, off: bool) -> None:
        """Break or restore the link to all other buses; only the liveliness tokens show it."""
        (self._network.cut_off.add if off else self._network.cut_off.discard)(self._name)
        for key in self._tokens:
            self._tell(key, alive=not off)

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token that lasts until this bus is closed."""
        self._tokens.append(key)
        self._tell(key, alive=True)

    def watch_alive(self, key_expr: str, on_change: Callable[[str, bool], None]) -> None:
        """Call ``on_change(key, alive)`` for every token, including those already declared."""
        with self._network.lock:
            self._network.watchers.append((key_expr, on_change))
            there = [key for key in self._network.tokens if matches(key_expr, key)]
        for key in there:
            on_change(key, True)

    def close(self) -> None:
        """Undeclare the tokens, as the end of a process would."""
        for key in self._tokens:
            self._tell(key, alive=False)

    def _tell(self, key: str, *, alive: bool) -> None:
        with self._network.lock:
            (self._network.tokens.append if alive else self._network.tokens.remove)(key)
            watchers = [w for expr, w in self._network.watchers if matches(expr, key)]
        for on_change in watchers:
            on_change(key, alive)
