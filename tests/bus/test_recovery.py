"""What a broken link swallowed is got from its sender: in order, once, and holding up nobody."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest
from bus_samples import TRACK, client, drain, envelope, estimate, router, seqs, take
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.bus import bus as bus_module
from rsenf.bus.bus import Bus, Publisher
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, SIGNALS, Delivery, alive_key
from rsenf.bus.sequence import Envelope
from rsenf.messages import Mark
from rsenf.run.process import wait_until
from tests.loopback import Loopback

FEW = Delivery(lossless=True, queue=8, history=5, kept=20)
OTHER = "rsenf/lab/other/track"


@contextmanager
def _zenoh() -> Iterator[tuple[Bus, Bus]]:
    with router() as (endpoint, _), client(endpoint) as a, client(endpoint) as b:
        yield a, b


@contextmanager
def _loopback() -> Iterator[tuple[Bus, Bus]]:
    network = Loopback()
    yield network.bus("a"), network.bus("b")


@pytest.fixture(params=[_zenoh, _loopback], ids=["zenoh", "loopback"])
def two(request: pytest.FixtureRequest) -> Iterator[tuple[Bus, Bus]]:
    with request.param() as both:
        yield both


@contextmanager
def broken(publisher: Publisher) -> Iterator[None]:
    """What is sent goes nowhere, and nobody notices."""
    put = publisher._put
    publisher._put = lambda item: None  # type: ignore[method-assign]
    yield
    publisher._put = put  # type: ignore[method-assign]


def opened(
    two: tuple[Bus, Bus], delivery: Delivery = SIGNALS, *, reading: Delivery = SIGNALS
) -> tuple[Publisher, Inbox]:
    """A sender's publisher and a receiver's inbox that know each other."""
    a, b = two
    inbox, publisher = Inbox(), a.publisher(TRACK, delivery)
    b.subscribe(inbox, TRACK, reading)
    while not publisher.is_heard:
        time.sleep(0.01)
    publisher.send(estimate(0))
    assert seqs(take(inbox, 1)) == [0]
    return publisher, inbox


def test_a_gap_is_filled_in_order_and_once(two: tuple[Bus, Bus]) -> None:
    publisher, inbox = opened(two)
    with broken(publisher):
        for seq in range(1, 200):
            publisher.send(estimate(seq))
    for seq in range(200, 210):
        publisher.send(estimate(seq))
    assert seqs(take(inbox, 209)) == list(range(1, 210))
    counters = inbox.counters
    assert (counters.recovered, counters.missed, counters.received) == (199, 0, 210)
    assert inbox.receive(0.1) is None


def test_what_nothing_follows_is_asked_for_when_its_sender_is_back(two: tuple[Bus, Bus]) -> None:
    publisher, inbox = opened(two)
    with broken(publisher):
        publisher.send(estimate(1))
        publisher.send(estimate(2, mark=Mark.END))
    assert inbox.receive(0.1) is None
    inbox.recover_tail(TRACK)
    assert seqs(take(inbox, 2)) == [1, 2]
    inbox.recover_tail(TRACK)  # nothing more, and nothing twice
    assert inbox.receive(0.2) is None
    assert (inbox.counters.recovered, inbox.counters.missed) == (2, 0)


def test_who_came_while_the_link_was_broken_is_heard_from_the_beginning(
    two: tuple[Bus, Bus],
) -> None:
    a, b = two
    inbox = Inbox()
    b.subscribe(inbox, "rsenf/lab/*/track", SIGNALS)
    seen = threading.Event()
    b.watch_alive(alive_key("lab", "*"), lambda key, alive: seen.set())
    publisher = a.publisher(TRACK, SIGNALS)
    with broken(publisher):
        publisher.send(estimate(0))
        publisher.send(estimate(1))
    a.declare_alive(alive_key("lab", "track"))
    assert seen.wait(20)
    inbox.recover_tail(TRACK)
    publisher.send(estimate(2))
    assert seqs(take(inbox, 3)) == [0, 1, 2]


def test_what_the_sender_has_forgotten_is_counted(two: tuple[Bus, Bus]) -> None:
    publisher, inbox = opened(two, FEW)
    with broken(publisher):
        for seq in range(1, 100):
            publisher.send(estimate(seq))
    publisher.send(estimate(100))
    assert seqs(take(inbox, 20)) == list(range(81, 101))
    assert (inbox.counters.recovered, inbox.counters.missed) == (19, 80)


def test_a_stream_that_began_anew_meanwhile_is_whole(two: tuple[Bus, Bus]) -> None:
    publisher, inbox = opened(two)
    with broken(publisher):
        publisher.send(estimate(1))
        for seq in range(5):
            publisher.send(estimate(seq, epoch=1))
    publisher.send(estimate(5, epoch=1))
    got = [(m.header.epoch, m.header.seq) for m in take(inbox, 7)]
    assert got == [(0, 1), *((1, seq) for seq in range(6))]
    assert inbox.counters.missed == 0


def test_who_only_looks_asks_for_nothing(two: tuple[Bus, Bus]) -> None:
    publisher, inbox = opened(two, reading=LOOKING)
    with broken(publisher):
        publisher.send(estimate(1))
    publisher.send(estimate(2))
    assert seqs(take(inbox, 1)) == [2]
    assert inbox.counters.missed == 1


def test_nobody_is_held_up_by_an_answer_that_takes_its_time() -> None:
    inbox, answered = Inbox(), threading.Event()

    def ask(key: str, after: str, before: str) -> list[object]:
        answered.wait(10)
        return [envelope(estimate(1), kept=True)]

    inbox.ask = ask  # type: ignore[assignment]
    for seq in (0, 2, 3):
        inbox.put(envelope(estimate(seq), kept=True), SIGNALS)
        inbox.put(envelope(estimate(seq // 2), OTHER), SIGNALS)
    assert seqs(drain(inbox)) == [0, 0, 1]  # all of the other camera, of this one what is sure
    answered.set()
    assert seqs(take(inbox, 3)) == [1, 2, 3]


def test_a_sender_that_keeps_nothing_is_never_asked() -> None:
    inbox = Inbox()
    inbox.ask = pytest.fail  # type: ignore[assignment]
    for seq in (0, 5, 6):
        inbox.put(envelope(estimate(seq)), SIGNALS)
    assert seqs(drain(inbox)) == [0, 5, 6]
    assert inbox.counters.missed == 4


def test_a_sender_that_does_not_answer_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rsenf.bus.inbox.PAUSES_S", (0.0, 0.01))
    inbox, asked = Inbox(), []
    inbox.ask = lambda *question: asked.append(question)
    for seq in (0, 5, 6):
        inbox.put(envelope(estimate(seq), kept=True), SIGNALS)
    assert seqs(take(inbox, 3)) == [0, 5, 6]
    assert len(asked) == 2
    assert inbox.counters.missed == 4


def test_what_is_kept_has_a_limit_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    size = len(envelope(estimate(200)).payload)
    monkeypatch.setattr(bus_module, "KEPT_BYTES", 10 * size)
    publisher = Loopback().bus("a").publisher(TRACK, SIGNALS)
    for seq in range(200, 300):
        publisher.send(estimate(seq))
        assert sum(len(item.payload) for item in publisher.history()) <= 10 * size
    assert len(publisher.history()) == 10


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from("sbetc"), max_size=60))
def test_whatever_breaks_whenever_nothing_is_lost_doubled_or_disordered(steps: str) -> None:
    """Sent, swallowed, a new epoch, taken, the sender seen again: in any order."""
    network = Loopback()
    inbox, publisher = Inbox(), network.bus("a").publisher(TRACK, SIGNALS)
    network.bus("b").subscribe(inbox, TRACK, SIGNALS)
    sent, epoch, seq = [], 0, 0

    def send(how: Callable[[object], None]) -> None:
        nonlocal seq
        sent.append((epoch, seq))
        how(estimate(seq, epoch=epoch))
        seq += 1

    def lose(message: object) -> None:
        with broken(publisher):
            publisher.send(message)

    got: list[tuple[int, int]] = []
    send(publisher.send)
    got += [(m.header.epoch, m.header.seq) for m in take(inbox, 1)]
    for step in steps:
        if step == "s":
            send(publisher.send)
        elif step == "b":
            send(lose)
        elif step == "e":
            epoch, seq = epoch + 1, 0
        elif step == "t":
            got += [(m.header.epoch, m.header.seq) for m in drain(inbox)]
        else:
            inbox.recover_tail(TRACK)
    inbox.recover_tail(TRACK)
    while len(got) < len(sent):
        received = inbox.receive(2.0)
        assert received is not None, f"{len(sent) - len(got)} never came"
        got.append((received.message.header.epoch, received.message.header.seq))
    assert got == sent
    assert inbox.counters.missed == 0


def test_what_is_too_large_is_not_taken_as_recovered_either() -> None:
    inbox = Inbox(largest_bytes=1000)
    kept = [envelope(estimate(seq), kept=True) for seq in range(4)]
    kept[1] = replace(kept[1], payload=kept[1].payload + bytes(1001))
    inbox.ask = lambda key, after, before: kept[1:3]
    for seq in (0, 3):
        inbox.put(kept[seq], SIGNALS)
    assert seqs(take(inbox, 3)) == [0, 2, 3]
    assert (inbox.counters.rejected, inbox.counters.missed) == (1, 1)


@pytest.mark.parametrize("heard", [[0, 1, 2, 6], [0, 1, 2, 4, 5, 6, 7]])
def test_a_run_that_ends_meanwhile_is_told_whole_and_once(heard: list[int]) -> None:
    """Its source was started again: those after it send on as another run."""
    inbox, sent = Inbox(), [("a", n) for n in range(5)] + [("b", n) for n in range(3)]
    kept = []
    for run, seq in sent:
        message = estimate(seq)
        message = replace(message, header=replace(message.header, run_id=run))
        kept.append(envelope(message, kept=True))
    may_answer = threading.Event()

    def ask(_key: str, after: str, before: str) -> list[Envelope]:
        may_answer.wait(5)
        return kept[3:6] if before else kept[3:]

    inbox.ask = ask
    for n in heard[:3]:
        inbox.put(kept[n], SIGNALS)
    told = take(inbox, 3)
    if len(heard) > 4:
        inbox.recover_tail(TRACK)
    for n in heard[3:]:
        inbox.put(kept[n], SIGNALS)
    assert inbox.receive(0.05) is None
    may_answer.set()
    inbox.put(kept[7], SIGNALS)
    told += take(inbox, 5)
    assert [(m.header.run_id, m.header.seq) for m in told] == sent
    assert inbox.receive(0.1) is None
    assert inbox.counters.missed == 0


def test_what_is_held_back_counts_as_waiting() -> None:
    inbox, answer = Inbox(), threading.Event()
    inbox.ask = lambda *question: [] if answer.wait(10) else None
    inbox.recover_tail("rsenf/lab/cam/track")
    assert inbox.depth == 1  # nobody may believe that all is here
    answer.set()
    assert wait_until(lambda: inbox.depth == 0)
