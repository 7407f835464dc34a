"""What all live sources share: joining while it runs, attempts, their spacing and their end."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
from decode_clips import make_clip, only_frames, pictures

from rsenf.decode import SourceSpec, StreamInfo
from rsenf.decode.live import LiveSource
from rsenf.decode.pump import Disconnected, Pump, Stop
from rsenf.decode.source import Item, Stamp
from rsenf.decode.stream import StreamDecoder
from rsenf.errors import SourceLost
from rsenf.messages import Frame
from rsenf.run.process import wait_until

STAMP = Stamp("lab/cam", "r", lambda: 0)


class Connection:
    """Gives two frames, then is lost."""

    def __init__(self, epoch: int) -> None:
        self.info = StreamInfo(codec=f"epoch {epoch}", live=True)
        self.damaged = 1
        self.pump = SimpleNamespace(overrun=3, waiting=0)
        self.warnings = ["a warning"]
        self.epoch = epoch

    def items(self) -> Iterator[Item]:
        for seq in range(2):
            header = STAMP.header(
                epoch=self.epoch, seq=seq, frame=seq, pts_ns=seq, camera_ns=0, arrival_ns=0
            )
            yield Frame(header=header)
        raise Disconnected("it fell asleep")

    def close(self) -> None:
        pass


def live(answers: list[bool], events: list[str], **spec: Any) -> LiveSource:
    """A source whose attempts to connect go as listed, then fail for ever."""
    outcomes = iter(answers)

    def connect(epoch: int) -> Connection:
        if next(outcomes, False):
            return Connection(epoch)
        raise Disconnected("nobody there")

    values = {"backoff_initial_s": 0.001, "backoff_max_s": 0.003, "max_reconnects": 3, **spec}
    return LiveSource(
        SourceSpec(url="rtsp://a:secret@cam/1", kind="rtsp", **values),
        STAMP,
        Stop(),
        connect,
        events.append,
    )


def test_attempts_are_spaced_ever_wider_and_end() -> None:
    events: list[str] = []
    source = live([True, False, True], events)
    items: list[Any] = []
    with pytest.raises(SourceLost, match=r"rtsp://\*\*\*@cam/1: nobody there"):
        items.extend(source)
    assert [(i.header.epoch, i.header.seq) for i in items] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    waits = [line.rpartition("next attempt in ")[2] for line in events if "next" in line]
    assert waits == ["0.001 s", "0.002 s", "0.001 s", "0.002 s", "0.003 s"]
    assert "it fell asleep" in events[0]
    assert not any("secret" in line for line in events)
    assert source.info.codec == "epoch 1"
    assert source.loss == (
        "lost the source 2 times, last: it fell asleep; damaged frames and packets: 2; "
        "pictures dropped for lack of time: 6"
    )
    assert source.warnings == ["a warning"]


def test_a_first_connection_may_be_waited_for() -> None:
    with pytest.raises(SourceLost):
        live([False, True], [])
    source = live([False, False, True], [], wait_for_source=True)
    first = next(iter(source))
    assert (first.header.epoch, first.header.seq) == (0, 0)


@pytest.mark.parametrize("encoder", ["libx264", "libvpx-vp9"])
def test_what_cannot_be_decoded_before_the_first_frame_is_not_lost(
    tmp_path: Path, encoder: str
) -> None:
    lumas = pictures(24)
    path = make_clip(tmp_path / "clip.mkv", lumas, encoder)  # a key frame every 8
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        spec = SourceSpec(url="rtsp://cam", kind="rtsp", threads=1)
        decoder = StreamDecoder(container, stream, spec, STAMP, live=True)
        items: list[Item] = []
        for packet in list(container.demux(stream))[3:]:
            items += decoder.feed(packet, 0)
    frames = only_frames(items)
    assert decoder.damaged_packets == 0
    assert frames[0].keyframe
    assert [f.header.seq for f in frames] == list(range(16))
    assert all(np.array_equal(f.luma, y) for f, y in zip(frames, lumas[8:], strict=True))


def test_a_session_whose_clock_jumps_back_has_ended(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(8), "mjpeg")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        spec = SourceSpec(url="rtsp://cam", kind="rtsp", threads=1)
        decoder = StreamDecoder(container, stream, spec, STAMP, live=True)
        packets = [p for p in container.demux(stream) if p.size]
        items = [i for n in (0, 1, 2, 1) for i in decoder.feed(packets[n], 0)]
    assert len(items) == 3
    assert "jump back" in decoder.ended


def test_a_pump_passes_on_what_its_thread_raises() -> None:
    def broken() -> Iterator[int]:
        yield 1
        raise ZeroDivisionError

    pump = Pump(broken, Stop(), bool)
    assert pump.get(30) == 1
    with pytest.raises(ZeroDivisionError):
        pump.get(30)
    ended: Pump[int] = Pump(lambda: iter(()), Stop(), bool)
    with pytest.raises(Disconnected):
        ended.get(30)


def test_who_stays_behind_is_given_what_is_new_from_a_key_picture_on() -> None:
    now_s = [0.0]
    ready, going = Event(), Event()

    def pictures_of_a_camera() -> Iterator[int]:
        for k in range(64):  # as many as may wait
            yield k
        ready.set()
        going.wait(30)
        now_s[0] = 1.0
        yield 64  # waits, until it has waited for too long
        for k in range(65, 90):
            yield k
        raise Disconnected("the end")

    pump = Pump(pictures_of_a_camera, Stop(), lambda k: k % 20 == 0, lambda: now_s[0])
    pump.may_drop = True
    assert ready.wait(30)
    going.set()
    while pump._full_since_s is None:
        time.sleep(0.001)
    now_s[0] = 5.0
    while pump._queue.qsize() == 64:
        time.sleep(0.001)
    assert pump.get(30) == 80
    assert pump.skipped == 80
    assert [pump.get(30) for _ in range(9)] == list(range(81, 90))
    assert pump.skipped == 0


def test_what_was_dropped_before_a_session_broke_is_counted() -> None:
    pump = Pump(lambda: iter(()), Stop(), bool)
    for dropped in (0, 69):
        with pytest.raises(Disconnected):
            pump.get(30)
        assert pump.overrun == dropped
        pump._queue.put((Disconnected("the end"), 69))


def test_before_anybody_takes_pictures_none_is_dropped() -> None:
    pump = Pump(lambda: iter(range(100)), Stop(), bool, iter(range(0, 10**6, 10)).__next__)
    assert wait_until(lambda: pump._queue.qsize() == 64)
    assert [pump.get(30) for _ in range(100)] == list(range(100))


def test_a_session_whose_clock_leaps_has_ended(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(4), "mjpeg")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        spec = SourceSpec(url="rtsp://cam", kind="rtsp", threads=1)
        decoder = StreamDecoder(container, stream, spec, STAMP, live=True)
        packets = [p for p in container.demux(stream) if p.size]
        assert packets[2].pts is not None
        assert stream.time_base is not None
        packets[2].pts += int(60 / stream.time_base)
        packets[2].dts = packets[2].pts
        items = [i for p in packets[:3] for i in decoder.feed(p, 0)]
    assert len(items) == 2
    assert decoder.ended == "its time stamps leap by 60 s"


def test_pictures_left_out_are_a_gap_in_the_numbers(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(6), "mjpeg")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        spec = SourceSpec(url="rtsp://cam", kind="rtsp", threads=1, with_packets=True)
        decoder = StreamDecoder(container, stream, spec, STAMP, live=True)
        packets = [p for p in container.demux(stream) if p.size]
        items = decoder.feed(packets[0], 0)
        decoder.skip(4)
        items += decoder.feed(packets[5], 0)
    assert [i.header.seq for i in items] == [0, 0, 5, 5]
