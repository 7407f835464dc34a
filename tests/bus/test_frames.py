"""Frames from sender to receiver, in the ring and in the message, lossless and live."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from bus_samples import FRAMES, frame, take

from rsenf.bus.bus import Publisher, apart
from rsenf.bus.frames import FrameReceiver, FrameSender
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import FRAMES_FILE, FRAMES_LIVE, Delivery
from rsenf.bus.ring import ring_directory
from rsenf.errors import NodeFailed, SchemaMismatch
from rsenf.messages import Frame, Header
from tests.loopback import Loopback

RING = "rsenf-test-frames"
ENDLESS = Delivery(lossless=True, queue=10_000, history=0)


@pytest.fixture(autouse=True)
def nothing_left_behind() -> Iterator[None]:
    yield
    assert list(ring_directory().glob(f"{RING}*")) == []


def pair(delivery: Delivery) -> tuple[Publisher, Inbox]:
    bus, inbox = Loopback().bus("a"), Inbox()
    bus.subscribe(inbox, FRAMES, dataclasses.replace(delivery, queue=10_000))
    return bus.publisher(FRAMES, delivery), inbox


def never() -> bool:
    return False


@pytest.mark.parametrize("ahead", [False, True], ids=["one by one", "some at once"])
@pytest.mark.parametrize("ring", [RING, ""])
def test_every_plane_comes_whole_and_in_order(ring: str, ahead: bool) -> None:
    """More frames than slots, of several sizes, with lines padded by the decoder."""
    publisher, inbox = pair(FRAMES_FILE)
    sender, receiver = FrameSender(publisher, ring, 5, never, ahead=ahead), FrameReceiver()
    sizes = [(6, 7)] * 10 + [(8, 853)] * 5 + [(4, 4)] * 3 + [(20, 1366)] * 5
    frames = [frame(seq, *size) for seq, size in enumerate(sizes)]
    padded = np.zeros((20, 1408), np.uint8)
    padded[:, :1366] = 77
    frames[-1] = dataclasses.replace(frames[-1], luma=padded[:, :1366])

    def send() -> None:
        for item in frames:
            sender.send(item)
        sender.finish(frames[-1].header)
        sender.close()

    sending = threading.Thread(target=send)
    sending.start()
    for sent in frames:
        message = take(inbox, 1)[0]
        assert bool(message.ring) == bool(ring)
        got = receiver.open(message)
        assert got is not None
        assert (got.ring, got.pixels) == ("", b"")
        assert np.array_equal(got.luma, sent.luma)
        assert got.header == sent.header
        receiver.done()
    end = receiver.open(take(inbox, 1)[0])
    assert end is not None
    assert end.header.is_end
    assert end.header.seq == len(frames)
    sending.join(10)
    assert not sending.is_alive()
    receiver.close()


@pytest.mark.parametrize(("ahead", "told"), [(False, [1] * 9), (True, [4, 4, 1])])
def test_of_frames_ahead_of_time_a_ring_full_is_told_of_at_once(
    ahead: bool, told: list[int]
) -> None:
    publisher, _ = pair(ENDLESS)
    puts: list[int] = []
    publisher._put = lambda item: puts.append(len(apart(item)))  # type: ignore[method-assign]
    sender = FrameSender(publisher, RING, 4, lambda: True, ahead=ahead)
    for seq in range(9):
        sender.send(frame(seq))
    publisher.flush()
    sender.close()
    assert puts == told


def test_a_live_sender_never_waits_and_what_is_read_is_whole() -> None:
    publisher, inbox = pair(FRAMES_LIVE)
    sender, receiver = FrameSender(publisher, RING, 4, never), FrameReceiver()
    for seq in range(20):
        sender.send(frame(seq))
    got = [receiver.open(message) for message in take(inbox, 20)]
    assert [g is not None for g in got] == [False] * 16 + [True] * 4
    luma = [g.luma for g in got if g]
    for seq in range(20, 30):
        sender.send(frame(seq))
    # Copies: what the writer does later can't reach them.
    assert [int(plane[0, 0]) for plane in luma if plane is not None] == [16, 17, 18, 19]
    sender.close()
    receiver.close()


def test_a_live_ring_that_was_replaced_and_removed_costs_frames_not_the_node() -> None:
    publisher, inbox = pair(FRAMES_LIVE)
    sender, receiver = FrameSender(publisher, RING, 4, never), FrameReceiver()
    sender.send(frame(0))
    assert receiver.open(take(inbox, 1)[0]) is not None
    sender.send(frame(1, 20, 20))
    sender.send(frame(2, 30, 30))
    first, second = take(inbox, 2)
    assert receiver.open(first) is None
    assert receiver.open(second) is not None
    sender.close()
    receiver.close()


def test_a_ring_on_another_host_is_one_clear_error() -> None:
    elsewhere = dataclasses.replace(frame(0), luma=None, ring=f"{RING}-none")
    with pytest.raises(NodeFailed, match="on this host") as caught:
        FrameReceiver().open(elsewhere)
    assert "tcp" in caught.value.hint


def test_a_reader_that_is_gone_holds_nobody_up() -> None:
    publisher, _ = pair(ENDLESS)
    sender = FrameSender(publisher, RING, 2, lambda: True)
    for seq in range(10):
        sender.send(frame(seq))
    sender.send(frame(10, 50, 50))
    sender.finish(Header(seq=10))
    sender.close()
    assert publisher.sent == 12


@pytest.mark.parametrize(("height", "width"), [(6, 8), (0, 0), (-6, -7), (42, 0)])
def test_pixels_that_do_not_fit_are_refused(height: int, width: int) -> None:
    with pytest.raises(SchemaMismatch):
        FrameReceiver().open(
            Frame(header=Header(), height_px=height, width_px=width, pixels=bytes(42))
        )


def test_a_reader_that_comes_back_is_shown_no_plane_that_is_written_anew() -> None:
    """Some are told of, together with others, after they were taken from the reader before."""
    publisher, inbox = pair(ENDLESS)
    gone = threading.Event()
    sender = FrameSender(publisher, RING, 4, gone.is_set, ahead=True)
    first, second = FrameReceiver(), FrameReceiver()
    for seq in range(4):
        sender.send(frame(seq))
    for message in take(inbox, 4)[:2]:
        assert first.open(message) is not None
        first.done()
    gone.set()  # with two planes that it hasn't given back
    for seq in range(4, 8):
        sender.send(frame(seq))
    gone.clear()
    read = []
    for seq, message in enumerate(take(inbox, 4), 4):
        got = second.open(message)
        if got is not None and got.luma is not None:
            writing = threading.Thread(target=sender.send, args=(frame(seq + 4),), daemon=True)
            writing.start()
            writing.join(0.1)
            assert int(got.luma[0, 0]) == seq
            read.append(seq)
            second.done()
            writing.join(10)
    assert read == [6, 7]
    first.close()
    second.close()
    sender.close()


def test_a_sender_ahead_waits_for_a_reader_that_is_restarted_and_tells_it_the_end_too() -> None:
    publisher, inbox = pair(ENDLESS)
    away, gone = threading.Event(), threading.Event()

    def departed() -> bool:  # while it is away, and once more when it is back
        was = gone.is_set()
        if not away.is_set():
            gone.clear()
        return was

    sender = FrameSender(publisher, RING, 2, departed, awaited=away.is_set, ahead=True)
    sent = [frame(seq) for seq in range(4)]
    sender.send(sent[0])
    sender.send(sent[1])
    away.set()
    gone.set()
    sending = threading.Thread(target=sender.send, args=(sent[2],))
    sending.start()
    sending.join(0.1)
    assert sending.is_alive()
    away.clear()  # it is back, and never gets the two planes of the one before
    sending.join(10)
    assert not sending.is_alive()
    ending = threading.Thread(target=sender.finish, args=(sent[2].header,))
    ending.start()
    receiver = FrameReceiver()
    messages = take(inbox, 4)
    assert [receiver.open(message) is not None for message in messages[:2]] == [False, False]
    assert [message.header.is_end for message in messages] == [False, False, False, True]
    away.set()  # it dies again, with the third plane and the end in its queue
    gone.set()
    ending.join(0.1)
    assert ending.is_alive()
    away.clear()
    ending.join(10)
    assert not ending.is_alive()
    assert publisher.sent == 5  # the end twice
    sender.close()
    receiver.close()
