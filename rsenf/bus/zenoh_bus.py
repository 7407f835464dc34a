"""The bus over Zenoh.

Three things that Zenoh leaves to its user are settled here (see also the README's page on the
bus): a sender that blocks must not be cut off after five seconds; who joins late subscribes, asks
for the history, and drops what came twice; and a session is always closed, or the interpreter
hangs at its exit.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import zenoh

from rsenf.bus.delivery import Delivery
from rsenf.bus.inbox import Envelope, Inbox
from rsenf.errors import RsenfError
from rsenf.messages import encode, encoding_of

HISTORY_TIMEOUT_S = 2.0
# Zenoh closes a link on which a blocked sender waits longer than this, and later messages vanish
# without a word. A slow recorder is no reason to lose data: an hour.
WAIT_BEFORE_CLOSE_US = 3_600_000_000


@dataclass(frozen=True)
class BusSettings:
    """How to reach the bus.

    Parameters
    ----------
    mode : {'client', 'router', 'peer'}
        'client' connects to a router; ``rsenf run`` opens one of its own in mode 'router'.
    connect, listen : tuple of str
        Zenoh endpoints, for example ``tcp/127.0.0.1:7447``.
    zenoh : mapping
        Any further Zenoh settings by their path (``transport/link/tls/…``): certificates, users.
    """

    mode: str = "client"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    multicast: bool = False
    zenoh: Mapping[str, Any] = field(default_factory=dict)


def _config(settings: BusSettings) -> zenoh.Config:
    values: dict[str, Any] = {
        "mode": settings.mode,
        "connect/endpoints": list(settings.connect),
        "listen/endpoints": list(settings.listen),
        "scouting/multicast/enabled": settings.multicast,
        "scouting/gossip/enabled": settings.multicast,
        "connect/timeout_ms": 5000,
        "connect/exit_on_failure": True,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": WAIT_BEFORE_CLOSE_US,
        **settings.zenoh,
    }
    config = zenoh.Config()
    for path, value in values.items():
        try:
            config.insert_json5(path, json.dumps(value))
        except zenoh.ZError as exc:
            raise RsenfError(f"bus setting {path}: {value!r} is not accepted ({exc})") from exc
    return config


class Publisher:
    """Sends the messages of one key, and keeps the last of them for those who join late."""

    def __init__(self, session: zenoh.Session, key: str, delivery: Delivery) -> None:
        self.sent = 0
        self.key = key
        self._sender = str(session.zid())
        self._history: deque[tuple[bytes, str]] = deque(maxlen=delivery.history)
        self._lock = threading.Lock()
        control = (
            zenoh.CongestionControl.BLOCK if delivery.lossless else zenoh.CongestionControl.DROP
        )
        self._publisher = session.declare_publisher(key, congestion_control=control)
        self._queryable = session.declare_queryable(key, self._answer) if delivery.history else None

    def send(self, message: Any) -> bytes:
        """Send a message; returns the bytes sent."""
        payload, encoding = encode(message), encoding_of(type(message))
        with self._lock:
            self._history.append((payload, encoding))
        self._publisher.put(payload, encoding=encoding, attachment=self._sender)
        self.sent += 1
        return payload

    def _answer(self, query: zenoh.Query) -> None:
        with query, self._lock:
            for payload, encoding in self._history:
                query.reply(self.key, payload, encoding=encoding, attachment=self._sender)


class _Subscription:
    """One key expression of an inbox: live messages wait until the history has come."""

    def __init__(self, inbox: Inbox, delivery: Delivery) -> None:
        self._inbox, self._delivery = inbox, delivery
        self._held: list[Envelope] | None = [] if delivery.history else None
        self._lock = threading.Lock()

    def on_sample(self, sample: zenoh.Sample) -> None:
        item = _envelope(sample)
        with self._lock:
            if self._held is not None:
                self._held.append(item)
                return
        self._inbox.put(item, self._delivery)

    def catch_up(self, replies: Iterator[Envelope]) -> None:
        for item in replies:
            self._inbox.put(item, self._delivery)
        # Held messages go in under the lock, so that no newer one can overtake them.
        with self._lock:
            for item in self._held or []:
                self._inbox.put(item, self._delivery)
            self._held = None


def _envelope(sample: zenoh.Sample) -> Envelope:
    attachment = sample.attachment
    return Envelope(
        str(sample.key_expr),
        str(sample.encoding),
        sample.payload.to_bytes(),
        attachment.to_string() if attachment is not None else "",
    )


class ZenohBus:
    """Publishers, inboxes and liveliness over one Zenoh session. Made by :func:`open_bus`."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._inboxes: list[Inbox] = []
        # Zenoh withdraws a declaration when Python forgets it.
        self._declared: list[Any] = []

    def publisher(self, key: str, delivery: Delivery) -> Publisher:
        """Open a key for sending."""
        return Publisher(self._session, key, delivery)

    def subscribe(self, inbox: Inbox, key_expr: str, delivery: Delivery) -> None:
        """Let an inbox receive a key expression, its history included, in order."""
        self._inboxes.append(inbox)
        subscription = _Subscription(inbox, delivery)
        self._declared.append(self._session.declare_subscriber(key_expr, subscription.on_sample))
        if delivery.history:
            replies = self._session.get(
                key_expr,
                timeout=HISTORY_TIMEOUT_S,
                consolidation=zenoh.ConsolidationMode.NONE,
                target=zenoh.QueryTarget.ALL,
            )
            subscription.catch_up(_envelope(r.ok) for r in replies if r.ok is not None)

    def declare_alive(self, key: str) -> None:
        """Show a liveliness token for as long as this process lives."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def watch_alive(self, key_expr: str, on_change: Callable[[str, bool], None]) -> None:
        """Call ``on_change(key, alive)`` for every token, those already there included."""

        def on_sample(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        watcher = self._session.liveliness().declare_subscriber(key_expr, on_sample, history=True)
        self._declared.append(watcher)

    def close(self) -> None:
        """Release the inboxes; the session is closed by :func:`open_bus`."""
        for inbox in self._inboxes:
            inbox.close()


@contextmanager
def open_bus(settings: BusSettings) -> Iterator[ZenohBus]:
    """Open a session for the duration of a ``with`` block.

    Raises
    ------
    RsenfError
        When the endpoints can't be reached, or refuse these credentials.
    """
    ends = ", ".join(settings.connect or settings.listen) or "the local network"
    try:
        session = zenoh.open(_config(settings))
    except zenoh.ZError as exc:
        raise RsenfError(
            f"no bus at {ends}",
            "is the router running, the address right, and the certificate or password accepted?",
        ) from exc
    bus = ZenohBus(session)
    try:
        yield bus
    finally:
        bus.close()
        session.close()  # type: ignore[no-untyped-call]  # zenoh's stub leaves it bare
