"""What every bus promises: the one over Zenoh and the one within a process alike."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
from bus_samples import TRACK, client, drain, estimate, next_of, router, seqs, take

from rsenf.bus.bus import Bus
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, SIGNALS, Delivery, alive_key
from rsenf.bus.sequence import Envelope
from rsenf.messages import encode
from tests.loopback import Loopback

Join = Callable[[str], Any]  # a context manager around a bus, as one process would have it


@contextmanager
def _over_zenoh() -> Iterator[Join]:
    with router() as (endpoint, _):
        yield lambda name: client(endpoint)


@contextmanager
def _within_a_process() -> Iterator[Join]:
    network = Loopback()

    @contextmanager
    def join(name: str) -> Iterator[Bus]:
        bus = network.bus(name)
        yield bus
        bus.close()

    yield join


@pytest.fixture(params=[_over_zenoh, _within_a_process], ids=["zenoh", "loopback"])
def join(request: pytest.FixtureRequest) -> Iterator[Join]:
    with request.param() as join:
        yield join


def meet(listener: Bus, sender: Bus) -> None:
    """Wait until what the sender sends reaches the listener, as the nodes of a graph do."""
    met = threading.Event()
    sender.watch_alive(alive_key("lab", "l"), lambda key, alive: met.set())
    listener.declare_alive(alive_key("lab", "l"))
    assert met.wait(10)


def test_what_is_sent_comes_in_order_and_whole(join: Join) -> None:
    with join("a") as a, join("b") as b:
        inbox = Inbox()
        b.subscribe(inbox, "rsenf/lab/*/track", SIGNALS)
        publisher = a.publisher(TRACK, SIGNALS)
        for seq in range(300):
            publisher.send(estimate(seq))
        assert seqs(take(inbox, 300)) == list(range(300))
        assert publisher.sent == inbox.counters.received == 300
        assert inbox.counters.missed == inbox.counters.rejected == 0


def test_who_joins_late_or_again_gets_the_history_once_and_in_order(join: Join) -> None:
    with join("a") as a, join("b") as b, join("c") as c:
        publisher = a.publisher(TRACK, Delivery(lossless=True, queue=100, history=40))
        for seq in range(100):
            publisher.send(estimate(seq))
        going, stop = threading.Event(), threading.Event()

        def go_on() -> None:
            for seq in itertools.count(100):
                if stop.is_set():
                    break
                publisher.send(estimate(seq))
                going.set()

        sending = threading.Thread(target=go_on)
        sending.start()
        going.wait(10)
        late = []
        for bus in (b, c):  # joins while it goes on, into a queue smaller than the history
            inbox = Inbox()
            bus.subscribe(inbox, TRACK, Delivery(lossless=True, queue=8, history=1))
            got = seqs(take(inbox, 150))
            assert got == list(range(got[0], got[0] + 150))
            assert inbox.counters.missed == 0
            late.append(got[0])
            inbox.close()
        stop.set()
        sending.join(20)
        assert not sending.is_alive()
        assert late[0] >= 60  # the last 40 of at least 100


def test_what_is_sent_together_comes_one_by_one_in_order_and_whole(join: Join) -> None:
    with join("a") as a, join("b") as b:
        inbox = Inbox()
        b.subscribe(inbox, TRACK, SIGNALS)
        meet(b, a)
        publisher = a.publisher(TRACK, SIGNALS)
        puts: list[Envelope] = []
        put = publisher._put
        publisher._put = lambda item: (puts.append(item), put(item))[1]  # type: ignore[method-assign]
        for seq in range(300):
            publisher.send(estimate(seq), more=seq < 299)
        assert len(puts) < 60  # at most 64 at once, or what comes in a tenth of a second
        received = [next_of(inbox) for _ in range(300)]
        assert [r.message.header.seq for r in received if r] == list(range(300))
        assert all(r.payload == encode(r.message) for r in received if r)
        assert publisher.sent == inbox.counters.received == 300
        assert inbox.counters.missed == inbox.counters.rejected == inbox.counters.duplicates == 0


def test_history_is_not_asked_for_where_there_is_none(join: Join) -> None:
    with join("a") as a, join("b") as b:
        publisher = a.publisher(TRACK, SIGNALS)
        publisher.send(estimate(0))
        inbox = Inbox()
        b.subscribe(inbox, TRACK, Delivery(lossless=True, queue=8, history=0))
        meet(b, a)
        publisher.send(estimate(1))
        assert seqs(take(inbox, 1)) == [1]


def test_a_slow_reader_of_a_lossless_topic_loses_nothing(join: Join) -> None:
    with join("a") as a, join("b") as b:
        slow = Delivery(lossless=True, queue=4, history=0)
        inbox = Inbox()
        b.subscribe(inbox, TRACK, slow)
        meet(b, a)
        publisher, count = a.publisher(TRACK, slow), 3000
        sending = threading.Thread(
            target=lambda: [publisher.send(estimate(seq)) for seq in range(count)]
        )
        sending.start()
        for seq in range(count):
            (message,) = take(inbox, 1)
            assert message.header.seq == seq
            assert inbox.depth <= 4
        sending.join(20)
        assert (inbox.counters.missed, inbox.counters.dropped) == (0, 0)


def test_who_only_looks_holds_nobody_up(join: Join) -> None:
    with join("a") as a, join("b") as b:
        looking = Inbox()
        b.subscribe(looking, TRACK, Delivery(lossless=False, queue=5, history=0))
        meet(b, a)
        publisher = a.publisher(TRACK, SIGNALS)
        for seq in range(500):
            publisher.send(estimate(seq))
        while looking.counters.dropped < 495:
            pass
        assert seqs(drain(looking)) == [495, 496, 497, 498, 499]
        assert (looking.counters.dropped, looking.counters.missed) == (495, 0)


def test_liveliness_is_seen_whoever_comes_first(join: Join) -> None:
    changes: list[tuple[str, bool]] = []
    changed = threading.Condition()

    def on_change(key: str, alive: bool) -> None:
        with changed:
            changes.append((key.split("/")[3], alive))
            changed.notify_all()

    def saw(*expected: tuple[str, bool]) -> bool:
        with changed:
            return changed.wait_for(lambda: sorted(changes) == sorted(expected), 10)

    with join("w") as watching, ExitStack() as stack:
        first = stack.enter_context(join("a"))
        first.declare_alive(alive_key("lab", "a"))
        watching.watch_alive(alive_key("lab", "*"), on_change)
        assert saw(("a", True))
        with join("b") as second:
            second.declare_alive(alive_key("lab", "b"))
            assert saw(("a", True), ("b", True))
        assert saw(("a", True), ("b", True), ("b", False))


def test_health_does_not_come_with_everything_else(join: Join) -> None:
    """Keys of nodes begin with '@', which wild cards don't cover."""
    from rsenf.bus.keys import HEALTH, health_key
    from rsenf.messages import Header, Health

    with join("a") as a, join("b") as b:
        everything, health = Inbox(), Inbox()
        b.subscribe(everything, "rsenf/lab/**", SIGNALS)
        b.subscribe(health, health_key("lab", "*"), LOOKING)
        a.publisher(health_key("lab", "n"), HEALTH).send(Health(header=Header(run_id="r")))
        a.publisher(TRACK, SIGNALS).send(estimate(0))
        assert seqs(take(everything, 1)) == [0]
        take(health, 1)
        assert everything.depth == 0
