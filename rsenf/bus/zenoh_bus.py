"""The bus over Zenoh.

What Zenoh leaves to its user is settled here: a sender that waits must not be cut off after five
seconds; a router all of whose receiving threads wait must not hold up the very messages they wait
for; who joins late subscribes, asks for the history, and drops what came twice; and a session is
always closed, or the interpreter hangs at its exit.
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import zenoh

from rsenf.bus.bus import Publisher, Subscription
from rsenf.bus.delivery import Delivery
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import no_key_expression
from rsenf.bus.sequence import Envelope
from rsenf.errors import RsenfError, UsageError

ECHO_KEY = "rsenf/@echo"
ECHO_TIMEOUT_S, NO_ECHO_S = 1.0, 0.3
# Who has played faster than others take it has much under way: as long as nobody is in a hurry.
SEEN_OFF_S, ECHO_POLL_S = 600.0, 0.01
HISTORY_TIMEOUT_S = 2.0
# What was missed in a minute takes a while over a slow link.
RECOVERY_TIMEOUT_S = 20.0
# In the attachment of a message, after its sender: that it is kept for who misses it.
KEPT = ";kept"
CONNECT_TIMEOUT_MS, RETRY_MS = 3000, 1000
# Zenoh closes a link on which a blocked sender waits longer than this, and later messages vanish
# without a word. A slow recorder is no reason to lose data: an hour.
WAIT_BEFORE_CLOSE_US = 3_600_000_000
# Between hosts a sender that waits may wait for a link that is broken, which isn't opened anew
# while anybody does; what is lost by closing it is got back.
LINKED_WAIT_US = 5_000_000
# A link on which nothing is heard for a lease counts as broken, and is closed with all that is on
# it. Where senders wait for a slow reader, a router doesn't listen to them for as long. Within a
# host nobody vanishes unheard: the end of a process closes its links.
LEASE_MS, LOCAL_LEASE_MS = 10_000, 3_600_000
LOCAL = ("/127.0.0.1:", "/localhost:", "/[::1]:")
# A thread that hands a message on waits for its receiver. On two cores Zenoh has one such thread: a
# frame that waits for the node that samples it would keep that node's own row blocks from coming
# in, and all would stand still. A router, or a peer, needs a thread for each of its links; who has
# but one link needs no more than two.
RUNTIME = "ZENOH_RUNTIME"
MANY_LINKS, ONE_LINK = "(rx: (worker_threads: 64))", "(rx: (worker_threads: 2))"


@dataclass(frozen=True)
class BusSettings:
    """How to reach the bus.

    Parameters
    ----------
    mode : {'client', 'router', 'peer'}
        'client' connects to a router; ``rsenf run`` opens one of its own in mode 'router'.
    connect, listen : tuple of str
        Zenoh endpoints, for example ``tcp/127.0.0.1:7447``. A router connects to other routers,
        and again and again to those that aren't there.
    multicast : bool
        Look for routers and peers in the local network.
    zenoh : mapping
        Any further Zenoh settings by their path (``transport/link/tls/…``): certificates, users.
    """

    mode: str = "client"
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    multicast: bool = False
    zenoh: Mapping[str, Any] = field(default_factory=dict)


def setting_problem(path: str, value: Any) -> str:
    """Say what is wrong with a Zenoh setting, without its value; empty when nothing is."""
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
        # Without anybody to look for, opening needn't wait half a second for answers.
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
        """Whether anybody has subscribed to the key."""
        status: Any = self._publisher.matching_status  # its stub says bool, which it isn't
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


# Parameters of a question for what was missed: places in the stream that it lies between.
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
        # Zenoh withdraws a declaration when Python forgets it.
        self._declared: list[Any] = []
        # Whether what is still under way at the end may be waited for only a moment.
        self.in_a_hurry: Callable[[], bool] = lambda: True

    def publisher(self, key: str, delivery: Delivery) -> Publisher:
        """Open a key for sending."""
        return _ZenohPublisher(self._session, key, delivery)

    def subscribe(self, inbox: Inbox, key_expr: str, delivery: Delivery) -> None:
        """Let an inbox receive a key expression, its history included, in order.

        Raises
        ------
        UsageError
            When it is no key expression.
        """
        self._inboxes.append(inbox)
        inbox.ask = self._ask
        subscription = Subscription(inbox, delivery)
        # What makes its sender wait does so in a thread of its own. Who only looks takes it as it
        # comes: to wake another thread for each message takes longer than what is done with it.
        handler: zenoh.handlers.Callback[zenoh.Sample] = zenoh.handlers.Callback(
            lambda sample: subscription.take(_envelope(sample)), indirect=delivery.lossless
        )
        try:
            subscriber = self._session.declare_subscriber(key_expr, handler)
        except zenoh.ZError as exc:
            raise no_key_expression(key_expr) from exc
        self._declared.append(subscriber)
        replies = self._query(key_expr, HISTORY_TIMEOUT_S) if delivery.history else ()
        subscription.catch_up(_envelope(reply.ok) for reply in replies if reply.ok)

    def _ask(self, key: str, after: str, before: str) -> list[Envelope] | None:
        """What the senders of a key have kept between two places; None when nobody answers."""
        with contextlib.suppress(zenoh.ZError):  # the session was closed meanwhile
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
            congestion_control=_BLOCK,  # of the replies too
        )
        return replies

    def declare_alive(self, key: str) -> None:
        """Show a liveliness token for as long as this process lives."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def watch_alive(self, key_expr: str, on_change: Callable[[str, bool], None]) -> None:
        """Call ``on_change(key, alive)`` for every token, those already there included."""

        def on_sample(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        watcher = self._session.liveliness().declare_subscriber(key_expr, on_sample, history=True)
        self._declared.append(watcher)

    def answer_echo(self) -> None:
        """Answer those who ask whether what they sent has arrived. For routers."""

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(ECHO_KEY, b"")

        self._declared.append(self._session.declare_queryable(ECHO_KEY, answer))

    def close(self) -> None:
        """Release the inboxes and see off what was sent; :func:`open_bus` closes the session.

        A session that closes forgets what still waits to be sent. A question of the lowest priority
        goes after all of it on the same link, so its answer means that the router has everything;
        and the routers of other hosts, to which it goes on.
        """
        for inbox in self._inboxes:
            inbox.close()
        replies = self._session.get(
            ECHO_KEY, timeout=SEEN_OFF_S, priority=zenoh.Priority.BACKGROUND,
            target=zenoh.QueryTarget.ALL, congestion_control=_BLOCK,
        )  # fmt: skip
        if not self._answered(replies):
            time.sleep(NO_ECHO_S)  # somebody else's router: nothing to do but give it time

    def _answered(self, replies: Any) -> bool:
        """Wait for all the answers; returns whether there was one. Not for long in a hurry."""
        answered, hurried_s = False, 0.0
        while hurried_s < ECHO_TIMEOUT_S:
            try:
                reply = replies.try_recv()
            except zenoh.ZError:  # that was all
                break
            if reply is None:
                time.sleep(ECHO_POLL_S)
                hurried_s += ECHO_POLL_S if self.in_a_hurry() else 0.0
            else:
                answered |= reply.ok is not None
        return answered


@contextmanager
def open_bus(settings: BusSettings) -> Iterator[ZenohBus]:
    """Open a session for the duration of a ``with`` block.

    Raises
    ------
    UsageError
        When a setting isn't one of Zenoh's.
    RsenfError
        When the endpoints can't be reached, or refuse these credentials.
    """
    config = _config(settings)
    os.environ.setdefault(RUNTIME, MANY_LINKS)  # read when a process opens its first session
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
        with contextlib.suppress(zenoh.ZError):  # a broken link is no reason not to end
            session.close()  # type: ignore[no-untyped-call]  # zenoh's stub leaves it bare


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
