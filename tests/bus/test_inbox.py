"""The queue behind every subscription: what waits, what is dropped, what is missing."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import pytest
from bus_samples import FRAMES, TRACK, drain, envelope, estimate, frame, seqs
from hypothesis import given, settings
from hypothesis import strategies as st

from rsenf.bus.bus import Subscription
from rsenf.bus.inbox import CallbackInbox, Inbox, Received
from rsenf.bus.keys import Delivery
from rsenf.bus.sequence import KEEPS_S, Envelope
from rsenf.messages import Candidate, Frame, Header, Health, Mark, RowBlock, encode, encoding_of

WAITING = Delivery(lossless=True, queue=3, history=5)
DROPPING = Delivery(lossless=False, queue=3, history=0)


def test_a_lossy_topic_drops_its_oldest_and_counts() -> None:
    inbox = Inbox()
    for seq in range(10):
        inbox.put(envelope(estimate(seq)), DROPPING)
    inbox.put(envelope(frame(0), FRAMES), DROPPING)  # another key has its own share
    assert inbox.depth == 4
    assert seqs(drain(inbox)) == [7, 8, 9, 0]
    assert (inbox.counters.dropped, inbox.counters.missed) == (7, 0)


def test_a_teller_keeps_nothing_and_tells_what_is_accepted() -> None:
    told: list[Received] = []
    teller = CallbackInbox(told.append)
    for seq in (0, 1, 1, 3):
        teller.put(envelope(estimate(seq)), DROPPING)
    teller.put(replace(envelope(estimate(4)), payload=b"\xff" * 9), DROPPING)
    assert [received.message.header.seq for received in told] == [0, 1, 3]
    assert (teller.depth, teller.counters.duplicates, teller.counters.rejected) == (0, 1, 1)


def test_what_was_sent_to_be_dropped_is_dropped_whoever_receives() -> None:
    inbox = Inbox()
    for seq in range(5):
        inbox.put(envelope(frame(seq), FRAMES, droppable=True), WAITING)
    assert seqs(drain(inbox)) == [2, 3, 4]


@given(st.lists(st.sampled_from("slt"), max_size=80))
def test_dropped_and_missed_add_up(steps: list[str]) -> None:
    """Whatever happens in whatever order: each number is received, dropped or missed, once."""
    inbox, got = Inbox(), []
    seq = 1
    inbox.put(envelope(estimate(0)), DROPPING)
    got += drain(inbox)
    for step in steps:
        if step == "t":
            got += [r.message for r in [inbox.receive(0)] if r]
            continue
        if step == "s":
            inbox.put(envelope(estimate(seq)), DROPPING)
        seq += 1
    inbox.put(envelope(estimate(seq)), DROPPING)
    got += drain(inbox)
    counters = inbox.counters
    assert counters.received == len(got)
    assert counters.missed == steps.count("l")
    assert counters.received + counters.dropped + counters.missed == seq + 1
    assert counters.duplicates == counters.rejected == 0
    assert seqs(got) == sorted(seqs(got))


def test_a_lossless_topic_makes_its_sender_wait_and_loses_nothing() -> None:
    inbox, count = Inbox(), 500
    sending = threading.Thread(
        target=lambda: [inbox.put(envelope(estimate(seq)), WAITING) for seq in range(count)]
    )
    sending.start()
    got = []
    while len(got) < count:
        received = inbox.receive(10)
        assert received is not None
        assert inbox.depth <= WAITING.queue
        got.append(received.message)
    sending.join(10)
    assert seqs(got) == list(range(count))
    assert (inbox.counters.missed, inbox.counters.dropped) == (0, 0)


def test_closing_lets_go_of_senders_and_receivers() -> None:
    inbox = Inbox()
    for seq in range(WAITING.queue):
        inbox.put(envelope(estimate(seq)), WAITING)
    sending = threading.Thread(target=inbox.put, args=(envelope(estimate(9)), WAITING))
    sending.start()
    inbox.close()
    sending.join(10)
    assert not sending.is_alive()
    assert seqs(drain(inbox)) == [0, 1, 2]
    assert inbox.receive(1000) is None


def test_gaps_are_counted_and_repeats_dropped() -> None:
    inbox = Inbox()
    for seq in (3, 4, 4, 3, 8, 9):
        inbox.put(envelope(estimate(seq)), Delivery(True, 100, 0))
    assert seqs(drain(inbox)) == [3, 4, 8, 9]
    assert (inbox.counters.missed, inbox.counters.duplicates) == (3, 2)


@pytest.mark.parametrize(
    "again",
    [
        envelope(estimate(0), sender="b"),  # its sender was started again
        envelope(estimate(0, epoch=1)),  # its source was connected again
        envelope(estimate(0, run_id="s")),  # another run
        envelope(estimate(0), key="rsenf/lab/cam2/track"),  # another camera
    ],
)
def test_numbers_that_begin_again_are_no_repeats(again: Envelope) -> None:
    inbox = Inbox()
    for seq in range(3):
        inbox.put(envelope(estimate(seq)), WAITING)
    drain(inbox)
    inbox.put(again, WAITING)
    assert seqs(drain(inbox)) == [0]
    assert (inbox.counters.missed, inbox.counters.duplicates) == (0, 0)


def test_a_stream_is_its_run_s_while_it_goes_on() -> None:
    """Another run of the graph, or a forger, can't end it, nor take it over."""
    inbox = Inbox()
    end = estimate(0, run_id="x")
    end = replace(end, header=replace(end.header, mark=Mark.END))
    forged = [envelope(end, sender="x"), envelope(estimate(9, run_id="x"), sender="x")]
    leap = envelope(estimate(2**40), sender="a")
    for item in [envelope(estimate(0)), *forged, leap, envelope(estimate(1))]:
        inbox.put(item, Delivery(True, 100, 0))
    assert seqs(drain(inbox)) == [0, 1]
    assert (inbox.counters.rejected, inbox.counters.missed) == (3, 0)
    later = replace(forged[1], arrived_s=time.monotonic() + 2 * KEEPS_S)
    inbox.put(later, Delivery(True, 100, 0))  # the run has gone without an END mark
    inbox.put(
        envelope(estimate(0, run_id="x.track1"), sender="y"), Delivery(True, 100, 0)
    )  # restarted
    assert seqs(drain(inbox)) == [9, 0]


def test_after_an_end_the_next_run_has_the_stream_at_once() -> None:
    inbox, end = Inbox(), estimate(1)
    end = replace(end, header=replace(end.header, mark=Mark.END))
    for item in (envelope(end), envelope(estimate(0, run_id="s"), sender="b")):
        inbox.put(item, Delivery(True, 100, 0))
    assert seqs(drain(inbox)) == [1, 0]


def test_foreign_and_broken_messages_are_counted_and_the_receiver_lives() -> None:
    good = envelope(estimate(0))
    bad = [
        replace(good, payload=b"\xff\xff\xff"),
        replace(good, encoding="text/plain"),
        replace(good, encoding=good.encoding.replace("/1", "/99")),
        replace(good, encoding="application/protobuf;rsenf.Unheard/1"),
        replace(good, encoding=""),
        envelope(RowBlock(header=Header())),  # a message, but not one of this topic
        envelope(Health(header=Header()), key=TRACK),
        Envelope(TRACK, encoding_of(Candidate), encode(Candidate()), "a"),  # without a header
        Envelope("x/y", encoding_of(Candidate), encode(Candidate()), "a"),
        replace(good, payload=b""),  # an estimate without a header
    ]
    inbox = Inbox()
    for item in [*bad, good]:
        inbox.put(item, Delivery(True, 100, 0))
    assert seqs(drain(inbox)) == [0]
    assert inbox.counters.rejected == len(bad)


@given(st.binary(max_size=60), st.sampled_from([TRACK, FRAMES, "rsenf/lab/cam/rows", "a"]))
def test_no_bytes_end_the_receiver(payload: bytes, key: str) -> None:
    inbox = Inbox()
    for encoding in (encoding_of(Frame), encoding_of(RowBlock), "x"):
        inbox.put(Envelope(key, encoding, payload, "a"), WAITING)
    drain(inbox)
    inbox.put(envelope(estimate(0), sender="other"), WAITING)
    assert seqs(drain(inbox)) == [0]


@settings(deadline=None)
@given(st.integers(0, 30), st.integers(0, 30), st.integers(0, 30))
def test_joining_late_brings_each_message_once_in_order(
    kept: int, overlap: int, fresh: int
) -> None:
    """History and what came meanwhile overlap; more of it waits than the queue would hold."""
    inbox = Inbox()
    subscription = Subscription(inbox, WAITING)
    overlap = min(overlap, kept)
    for seq in range(kept - overlap, kept + fresh):
        subscription.take(envelope(estimate(seq)))
    assert inbox.depth == 0  # held back until the history is here
    subscription.deliver_history(envelope(estimate(seq)) for seq in range(kept))
    assert seqs(drain(inbox)) == list(range(kept + fresh))
    assert (inbox.counters.duplicates, inbox.counters.missed) == (overlap, 0)


def test_no_message_overtakes_those_held_while_joining() -> None:
    inbox = Inbox()
    subscription = Subscription(inbox, Delivery(True, 10_000, 5))
    going = threading.Event()

    def live() -> None:
        for seq in range(3000):
            subscription.take(envelope(estimate(seq)))
            going.set()

    sending = threading.Thread(target=live)
    sending.start()
    going.wait(10)
    subscription.deliver_history([])
    sending.join(30)
    assert seqs(drain(inbox)) == list(range(3000))
    assert inbox.counters.duplicates == 0


def rows_of(
    inbox: Inbox, run_id: str, first: int, last: int, *, epoch: int = 0, mark: int = 0
) -> None:
    header = Header(
        run_id=run_id, source="lab/cam", epoch=epoch, seq=first // 8, mark=mark,
        frame_first=first, frame_last=last,
    )  # fmt: skip
    sent = replace(envelope(RowBlock(header=header), "rsenf/lab/cam/rows"), sender=run_id)
    inbox.put(sent, WAITING)
    drain(inbox)


def test_frames_without_rows_are_counted_where_their_sampler_was_restarted() -> None:
    inbox = Inbox()
    rows_of(inbox, "r", 0, 7)
    rows_of(inbox, "r.rows1", 30, 31)  # 8 to 29, two blocks of them whole
    assert (inbox.counters.uncovered["rsenf/lab/cam/rows"], inbox.counters.missed) == (22, 2)
    rows_of(inbox, "r.rows2", 32, 39)
    assert inbox.counters.uncovered["rsenf/lab/cam/rows"] == 22
    rows_of(inbox, "r.rows3", 99, 99, mark=Mark.END)  # it got the end alone
    assert inbox.counters.uncovered["rsenf/lab/cam/rows"] == 22 + 60


def test_a_reader_that_was_restarted_counts_what_is_missing_after_what_it_had_taken() -> None:
    key = "rsenf/lab/cam/rows"
    had = {key: Header(run_id="r", source="lab/cam", seq=0, frame_first=0, frame_last=7)}
    for run_id, first, lost in (("r", 0, 0), ("r", 8, 0), ("r", 32, 24), ("r.rows1", 32, 24)):
        inbox = Inbox()
        inbox.resume(had)
        rows_of(inbox, run_id, first, first + 7)
        rows_of(inbox, run_id, first + 8, first + 15)
        assert (inbox.counters.uncovered[key], inbox.counters.missed) == (lost, lost // 8)
    inbox = Inbox()
    inbox.resume(had)
    rows_of(inbox, "other", 32, 39)  # of another run, it can't be known
    assert (inbox.counters.uncovered[key], inbox.counters.missed) == (0, 0)


def test_what_comes_late_of_a_killed_process_was_not_missed() -> None:
    """Its last messages are read from its link while those of the next come over another."""
    inbox = Inbox()
    key = "rsenf/lab/cam/rows"
    rows_of(inbox, "r", 0, 7)
    rows_of(inbox, "r.rows1", 40, 47)
    assert (inbox.counters.uncovered[key], inbox.counters.missed) == (32, 4)
    for late, (first, next_first) in enumerate(((8, 48), (16, 56), (24, 64)), 1):
        rows_of(inbox, "r", first, first + 7)
        rows_of(inbox, "r.rows1", next_first, next_first + 7)
        assert (inbox.counters.uncovered[key], inbox.counters.missed) == (32 - 8 * late, 4 - late)
    rows_of(inbox, "r", 0, 0, mark=Mark.END)
    rows_of(inbox, "r.rows2", 72, 79)
    assert (inbox.counters.uncovered[key], inbox.counters.missed) == (8, 1)


def test_a_message_without_frames_hides_none_that_are_missing() -> None:
    inbox = Inbox()
    rows_of(inbox, "r", 0, 7)
    rows_of(inbox, "r", -1, -1)
    rows_of(inbox, "r.rows1", 30, 31)
    assert inbox.counters.uncovered["rsenf/lab/cam/rows"] == 22


def test_frames_of_a_source_that_began_anew_are_not_missed() -> None:
    inbox = Inbox()
    rows_of(inbox, "r", 0, 7)
    rows_of(inbox, "r.decode1", 0, 7)
    rows_of(inbox, "r.decode1.rows1", 80, 87, epoch=1)
    rows_of(inbox, "r.decode1.rows1", 87, 87, epoch=1, mark=Mark.END)
    rows_of(inbox, "other", 800, 807)
    assert inbox.counters.uncovered["rsenf/lab/cam/rows"] == inbox.counters.missed == 0


def test_a_reader_that_was_there_from_the_first_counts_what_came_before_the_first_block() -> None:
    for whole, lost in ((True, 24), (False, 0)):
        inbox = Inbox()
        inbox.whole = whole
        rows_of(inbox, "r.rows1", 24, 31)
        assert inbox.counters.uncovered["rsenf/lab/cam/rows"] == lost


def test_a_history_takes_no_room_from_what_is_sent_meanwhile() -> None:
    inbox = Inbox()
    inbox.put_all(envelope(estimate(seq)) for seq in range(10))
    for seq in range(10, 13):
        inbox.put(envelope(estimate(seq)), WAITING)  # for ever, if the history filled the queue
    assert seqs(drain(inbox)) == list(range(13))
    inbox.put_all(envelope(estimate(seq)) for seq in range(13, 23))
    for seq in range(23, 33):
        inbox.put(envelope(estimate(seq)), DROPPING)
    assert seqs(drain(inbox)) == [*range(13, 23), *range(30, 33)]
    assert (inbox.counters.dropped, inbox.counters.missed) == (7, 0)
