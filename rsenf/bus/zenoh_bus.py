"""The bus over Zenoh.

It settles what Zenoh leaves to its user: a blocked sender must not be disconnected after five
seconds (Zenoh's default); receive threads that block must not deadlock a router; a late joiner
subscribes, queries the history and drops duplicates; and a session is always closed, or the
interpreter hangs at exit.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import zenoh

from rsenf.bus.bus import Publisher, Subscription
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import Delivery, no_key_expression
from rsenf.bus.sequence import Envelope
from rsenf.errors import RsenfError, UsageError

ECHO_KEY = "rsenf/@echo"
ECHO_TIMEOUT_S, NO_ECHO_S = 1.0, 0.3
# Longest wait at the end until everything sent has arrived: a fast replay may have much in transit.
SEEN_OFF_S, ECHO_POLL_S = 600.0, 0.01
HISTORY_TIMEOUT_S = 2.0
# The messages of a minute take a while over a slow link.
RECOVERY_TIMEOUT_S = 20.0
# Suffix of the sender in a message's attachment: the message is kept for recovery.
KEPT = ";kept"
CONNECT_TIMEOUT_MS, RETRY_MS = 3000, 1000
# Zenoh closes a link on which a sender blocks longer than this, and silently drops later messages.
# A slow recorder must not lose data: one hour.
WAIT_BEFORE_CLOSE_US = 3_600_000_000
# Between hosts a sender may block on a broken link, which isn't reopened as long as it blocks. What
# is lost by closing the link is recovered afterwards.
LINKED_WAIT_US = 5_000_000
# A link that is silent for a lease counts as broken and is closed with all that is on it. A router
# doesn't read from senders while these block on a slow reader. Within a host a long lease is safe:
# the end of a process closes its links.
LEASE_MS, LOCAL_LEASE_MS = 10_000, 3_600_000
LOCAL = ("/127.0.0.1:", "/localhost:", "/[::1]:")
# A Zenoh receive thread blocks while a receiver is full. On two cores Zenoh has a single one, which
# can deadlock: a frame that waits for the row sampler blocks that node's own row blocks. A router
# or peer needs one thread for each link; a process with one link needs two at most.
RUNTIME = "ZENOH_RUNTIME"
MANY_LINKS, ONE_LINK = "(rx: (worker_threads: 64))", "(rx: (worker_threads: 2))"


@dataclass(frozen=True)
class BusSettings:
    """How to reach the bus.

    Parameters
    ----------
    mode : {'client', 'router', 'peer'}
        'client' connects to a router; ``rsenf run`` opens its own one in mode 'router'.
    connect, listen : tuple of str
        Zenoh endpoints, for example ``tcp/127.0.0.1:7447``. A router keeps trying to connect to
        other routers.
    multicast : bool
        Look for routers and peers in the local network.
    zenoh : mapping
        Further Zenoh settings by path (``transport/link/tls/…``), for example certificates, users.
    """

    mode: str = "client"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    multicast: bool = False
    zenoh: Mapping[str, Any] = field(default_factory=dict)


def setting_problem(path: str, value: Any) -> str:
    """Say what is wrong with a Zenoh setting, without its value; empty if it is valid.

    Parameters
    ----------
    path : str
        Such as ``transport/link/tx/lease``.
    value : JSON value
    """
    try:
        zenoh.Config().insert_json5(path, json.dumps(value))
    except zenoh.ZError as exc:
        text = str(exc).rpartition(" at /")[0]
        return f"no setting of Zenoh: {text.rpartition('msg: ')[2].removeprefix(chr(34))}"
    return ""


def _config(settings: BusSettings) -> zenoh.Config:
    patient = settings.mode == "router"
    linked = patient and (settings.connect or len(settings.listen) > 1)
    wait_us = LINKED_WAIT_US if linked else WAIT_BEFORE_CLOSE_US
    endpoints = (*settings.connect, *settings.listen)
    local = endpoints and all(any(part in e for part in LOCAL) for e in endpoints)
    values: dict[str, Any] = {
        "mode": settings.mode,
        "connect/endpoints": list(settings.connect),
        "listen/endpoints": list(settings.listen),
        "scouting/multicast/enabled": settings.multicast,
        "scouting/gossip/enabled": settings.multicast,
        "connect/timeout_ms": -1 if patient else CONNECT_TIMEOUT_MS,
        "connect/exit_on_failure": not patient,
        "connect/retry": {"period_init_ms": RETRY_MS, "period_increase_factor": 1},
        "transport/shared_memory/enabled": False,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": wait_us,
        "transport/link/tx/lease": LOCAL_LEASE_MS if local else LEASE_MS,
        # Without scouting, opening a session needn't wait half a second for answers.
        **({} if settings.multicast else {"scouting/delay": 0}),
        **settings.zenoh,
    }
    config = zenoh.Config()
    for path, value in values.items():
        if problem := setting_problem(path, value):
            raise UsageError(f"bus setting {path}: {problem}")
        config.insert_json5(path, json.dumps(value))
    return config


class _ZenohPublisher(Publisher):
    def __init__(self, session: zenoh.Session, key: str, delivery: Delivery) -> None:
        super().__init__(key, delivery, str(session.zid()))
        self._publisher = session.declare_publisher(
            key,
            congestion_control=_BLOCK if delivery.lossless else zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME if delivery.urgent else zenoh.Priority.DEFAULT,
        )
        self._attachment = self.sender + (KEPT if self.keeps else "")
        self._queryable = session.declare_queryable(key, self._answer) if self.keeps else None

    @property
    def is_heard(self) -> bool:
        """Whether the key has a subscriber."""
        status: Any = self._publisher.matching_status  # not the bool that its stub declares
        return bool(status.matching)

    def _put(self, item: Envelope) -> None:
        self._publisher.put(item.payload, encoding=item.encoding, attachment=self._attachment)

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            asked = query.parameters
            after, before = asked.get(AFTER), asked.get(BEFORE)
            items = self.history() if after is None else self.between(after, before or "")
            for item in items:
                query.reply(
                    item.key, item.payload, encoding=item.encoding, attachment=self._attachment
                )
            if after is not None and not items:
                query.reply_err(NOTHING_KEPT)


# Parameters of a recovery query: the places in the stream around the gap.
AFTER, BEFORE = "after", "before"
NOTHING_KEPT = zenoh.ZBytes(b"nothing kept")
_BLOCK = zenoh.CongestionControl.BLOCK


def _envelope(sample: zenoh.Sample) -> Envelope:
    attachment = sample.attachment
    said = attachment.to_bytes().decode(errors="replace") if attachment is not None else ""
    return Envelope(
        str(sample.key_expr),
        str(sample.encoding),
        sample.payload.to_bytes(),
        said.removesuffix(KEPT),
        droppable=sample.congestion_control != _BLOCK,
        kept=said.endswith(KEPT),
    )


class ZenohBus:
    """A :class:`rsenf.bus.bus.Bus` over one Zenoh session. Made by :func:`open_bus`."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._inboxes: list[Inbox] = []
        # Zenoh undeclares what Python garbage-collects.
        self._declared: list[Any] = []
        self._subscribers: list[Any] = []
        # Whether closing may wait only briefly for messages in transit.
        self.in_a_hurry: Callable[[], bool] = lambda: True

    def publisher(self, key: str, delivery: Delivery) -> Publisher:
        """Open a key for sending."""
        return _ZenohPublisher(self._session, key, delivery)

    def subscribe(self, inbox: Inbox, key_expr: str, delivery: Delivery) -> None:
        """Subscribe an inbox to a key expression: history first, then live messages.

        Raises
        ------
        UsageError
            When the text is no key expression.
        """
        self._inboxes.append(inbox)
        inbox.ask = self._ask
        subscription = Subscription(inbox, delivery)
        # A blocking subscriber needs its own thread. Observers run in Zenoh's: waking another
        # thread for each message takes longer than their work on it.
        handler: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(
            lambda sample: subscription.take(_envelope(sample)), indirect=delivery.lossless
        )
        try:
            subscriber = self._session.declare_subscriber(key_expr, handler)
        except zenoh.ZError as exc:
            raise no_key_expression(key_expr) from exc
        self._subscribers.append(subscriber)
        selector = f"{key_expr}?{AFTER}=;{BEFORE}=" if inbox.restarted else key_expr
        replies = self._query(selector, HISTORY_TIMEOUT_S) if delivery.history else ()
        subscription.deliver_history(_envelope(reply.ok) for reply in replies if reply.ok)

    def _ask(self, key: str, after: str, before: str) -> list[Envelope] | None:
        """Return the kept messages of a key between two places; None if no sender answers."""
        with contextlib.suppress(zenoh.ZError):  # raised when the session was closed meanwhile
            replies = self._query(f"{key}?{AFTER}={after};{BEFORE}={before}", RECOVERY_TIMEOUT_S)
            answers = list(replies)
            said = [r for r in answers if r.ok or (r.err and r.err.payload == NOTHING_KEPT)]
            return [_envelope(r.ok) for r in said if r.ok] if said else None
        return None

    def _query(self, selector: str, timeout_s: float) -> Iterable[zenoh.Reply]:
        replies: Iterable[zenoh.Reply] = self._session.get(
            selector,
            timeout=timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,
            target=zenoh.QueryTarget.ALL,
            congestion_control=_BLOCK,  # also for the replies
        )
        return replies

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token that lasts as long as this process."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def watch_alive(self, key_expr: str, on_change: Callable[[str, bool], None]) -> None:
        """Call ``on_change(key, alive)`` for every token, including those already declared."""

        def on_sample(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        watcher = self._session.liveliness().declare_subscriber(key_expr, on_sample, history=True)
        self._declared.append(watcher)

    def answer_echo(self) -> None:
        """Answer the queries by which senders check that everything has arrived. For routers."""

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(ECHO_KEY, b"")

        self._declared.append(self._session.declare_queryable(ECHO_KEY, answer))

    def close(self) -> None:
        """Close the inboxes, unsubscribe, and wait until everything sent has arrived.

        Closing a session (by :func:`open_bus`) discards what is still queued. A query of the lowest
        priority is sent after all of it on the same link, so its answers mean that the router, and
        the routers of other hosts that forward the query, have everything, and that nothing more is
        on its way to here. A router that is just sending to a session that closes may block until
        ``WAIT_BEFORE_CLOSE_US`` is over, and with it all others whose messages it carries.
        """
        for inbox in self._inboxes:
            inbox.close()
        with contextlib.suppress(zenoh.ZError):  # such as for a broken link
            for subscriber in self._subscribers:
                subscriber.undeclare()
        replies = self._session.get(
            ECHO_KEY, timeout=SEEN_OFF_S, priority=zenoh.Priority.BACKGROUND,
            target=zenoh.QueryTarget.ALL, congestion_control=_BLOCK,
        )  # fmt: skip
        if not self._answered(replies):
            time.sleep(NO_ECHO_S)  # a foreign router doesn't answer: just give it time

    def _answered(self, replies: Any) -> bool:
        """Wait for all answers, in a hurry only briefly; return whether there was any."""
        answered, hurried_s = False, 0.0
        while hurried_s < ECHO_TIMEOUT_S:
            try:
                reply = replies.try_recv()
            except zenoh.ZError:  # no more answers
                break
            if reply is None:
                time.sleep(ECHO_POLL_S)
                hurried_s += ECHO_POLL_S if self.in_a_hurry() else 0.0
            else:
                answered |= reply.ok is not None
        return answered


def free_endpoint() -> str:
    """Return a free TCP endpoint on the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def open_bus(settings: BusSettings) -> Iterator[ZenohBus]:
    """Open a session for the duration of a ``with`` block.

    Raises
    ------
    UsageError
        When a setting isn't one of Zenoh's.
    RsenfError
        When the endpoints can't be reached or opened, or refuse these credentials.
    """
    config = _config(settings)
    os.environ.setdefault(RUNTIME, MANY_LINKS)  # Zenoh reads it at the process's first session
    try:
        session = zenoh.open(config)
    except zenoh.ZError as exc:
        raise _unreachable(settings) from exc
    bus = ZenohBus(session)
    if settings.mode == "router":
        bus.answer_echo()
    try:
        yield bus
    finally:
        bus.close()
        with contextlib.suppress(zenoh.ZError):  # such as for a broken link
            session.close()  # type: ignore[no-untyped-call]  # untyped in zenoh's stub


def _unreachable(settings: BusSettings) -> RsenfError:
    if settings.listen:
        return RsenfError(
            f"no bus can be opened at {', '.join(settings.listen)}",
            "is the address one of this host's, and the port free?",
        )
    return RsenfError(
        f"no bus at {', '.join(settings.connect) or 'the local network'}",
        "is the router running, the address right, and the certificate or password accepted?",
    )
