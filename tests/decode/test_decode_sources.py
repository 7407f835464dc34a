"""What all sources share: addresses without passwords, pacing, stopping, made frames."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event

import numpy as np
import pytest
from decode_clips import only_frames, pictures
from numpy.typing import NDArray

from rsenf.decode import SourceSpec, StreamInfo, from_frames, kind_of, redact
from rsenf.decode.pump import Pacer, Stop


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("rtsp://10.0.0.2:554/cam/1", "rtsp://10.0.0.2:554/cam/1"),
        ("rtsp://admin:secret@10.0.0.2/cam", "rtsp://***@10.0.0.2/cam"),
        ("rtsp://admin:se/c@ret@10.0.0.2/cam", "rtsp://***@10.0.0.2/cam"),
        ("rtsp://10.0.0.2/cam?user=admin&password=secret", "rtsp://10.0.0.2/cam?***"),
        ("rtsp://10.0.0.2/user=admin_password=secret_channel=1", "rtsp://10.0.0.2/***"),
        ("rtsp://10.0.0.2/cam?password=sec@ret", "rtsp://***"),
        ("RTSPS://a:secret@h/x failed", "RTSPS://***@h/x failed"),
        ("two: http://a:secret@h, rtsp://b:secret@h", "two: http://***@h, rtsp://***@h"),
        ("rtsp://me:my secret@10.0.0.2/cam: lost", "rtsp://***@10.0.0.2/cam: lost"),
        ("rtsp://10.0.0.2:554/cam is lost, ask a@b", "rtsp://10.0.0.2:554/cam is lost, ask a@b"),
        ("/home/me/clip@home.mp4", "/home/me/clip@home.mp4"),
    ],
)
def test_no_password_is_ever_shown(address: str, shown: str) -> None:
    assert redact(address) == shown
    spec = SourceSpec(url=address, kind="rtsp")
    assert spec.name == shown
    assert "secret" not in repr(spec)


@pytest.mark.parametrize(
    ("url", "kind"),
    [
        ("clip.mp4", "file"),
        ("/data/rtsp/clip.mkv", "file"),
        ("rtsp://host/cam", "rtsp"),
        ("RTSPS://host/cam", "rtsp"),
        ("http://host/video.mjpg", "rtsp"),
        ("/dev/video2", "v4l2"),
        ("/dev/v4l/by-id/usb-cam", "v4l2"),
        ("0", "v4l2"),
        ("v4l2:camera", "v4l2"),
    ],
)
def test_the_kind_is_told_from_the_address(url: str, kind: str) -> None:
    assert kind_of(url) == kind


class FakeTime:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept: list[float] = []

    def sleep(self, duration_s: float) -> None:
        self.slept.append(duration_s)
        self.now_s += duration_s


def test_the_pacer_holds_frames_back_to_their_times_and_never_hurries() -> None:
    fake = FakeTime()
    pacer = Pacer(lambda: fake.now_s, fake.sleep)
    pacer.wait_for(5_000_000_000)
    assert fake.slept == []  # the first sets the clock
    pacer.wait_for(5_040_000_000)
    fake.now_s += 1.0  # a slow consumer
    pacer.wait_for(5_080_000_000)
    pacer.wait_for(6_100_000_000)
    assert fake.slept == pytest.approx([0.04, 0.06])


def test_a_stop_ends_a_wait_from_either_side() -> None:
    outside = Event()
    stop = Stop(outside)
    assert not stop.wait(0.0)
    outside.set()
    assert stop.wait(3600)
    closed = Stop(Event())
    closed.set()
    assert closed.wait(3600)
    alone = Stop()
    alone.set()
    assert alone.wait(3600)


def test_made_frames_are_a_source_like_any_other() -> None:
    lumas = pictures(5)
    times_ns = [n * 33_366_667 + 1_000 for n in range(5)]
    info = StreamInfo(
        codec="rawvideo", width_px=64, height_px=48, camera_start_ns=10**18, rotation_deg=90
    )
    ticks = iter(range(100, 200))
    with from_frames(
        zip(times_ns, lumas, strict=True),
        info,
        source="lab/sim",
        run_id="r1",
        clock_ns=lambda: next(ticks),
    ) as source:
        frames = only_frames(source)
    assert source.info is info
    assert source.loss == ""
    assert [f.header.pts_ns for f in frames] == times_ns
    assert [f.header.arrival_time_ns for f in frames] == [100, 101, 102, 103, 104]
    assert [f.header.camera_time_ns for f in frames] == [10**18 + t - 1_000 for t in times_ns]
    assert [(f.header.seq, f.header.frame_first, f.header.frame_last) for f in frames] == [
        (n, n, n) for n in range(5)
    ]
    assert {(f.header.source, f.header.run_id, f.header.epoch) for f in frames} == {
        ("lab/sim", "r1", 0)
    }
    assert {(f.width_px, f.height_px, f.rotation_deg, f.codec) for f in frames} == {
        (64, 48, 90, "rawvideo")
    }
    assert all(np.array_equal(f.luma, y) for f, y in zip(frames, lumas, strict=True))


def test_a_paced_source_stops_in_the_middle_of_a_wait() -> None:
    stop = Event()
    hour_ns = 3600 * 1_000_000_000

    def frames() -> Iterator[tuple[int, NDArray[np.uint8]]]:
        for n, luma in enumerate(pictures(3)):
            yield n * hour_ns, luma
            stop.set()

    made = from_frames(
        frames(), StreamInfo(), source="a/b", run_id="r", clock_ns=lambda: 0, pace=True, stop=stop
    )
    assert len(only_frames(made)) == 1
