"""V4L2 cameras, by a fake of OpenCV's capture: formats, clocks, stalls, reconnection."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import cv2
import numpy as np
import pytest
from decode_clips import only_frames, only_packets, pictures
from numpy.typing import NDArray

from rsenf.decode import SourceSpec, VideoSource, open_source
from rsenf.errors import SourceLost

HEIGHT_PX, WIDTH_PX = 48, 64


@dataclass
class FakeCapture:
    """Gives its images one after the other, then fails, or hangs until it is let go."""

    images: Sequence[NDArray[Any]]
    fourcc: str = "YUYV"
    times_ms: Sequence[float] = ()
    opened: bool = True
    hang: Event | None = None
    released: Event = field(default_factory=Event)
    taken: int = 0

    def isOpened(self) -> bool:
        return self.opened

    def read(self) -> tuple[bool, NDArray[Any]]:
        if self.taken == len(self.images):
            if self.hang:
                self.hang.wait()
            return False, np.empty(0)
        self.taken += 1
        return True, self.images[self.taken - 1]

    def get(self, prop: int) -> float:
        return {
            cv2.CAP_PROP_FOURCC: float(int.from_bytes(self.fourcc.encode(), "little")),
            cv2.CAP_PROP_FRAME_HEIGHT: float(HEIGHT_PX),
            cv2.CAP_PROP_FPS: 30.0,
            cv2.CAP_PROP_POS_MSEC: self.times_ms[self.taken - 1] if self.times_ms else 0.0,
        }[prop]

    def release(self) -> None:
        self.released.set()


def open_fake(
    *captures: FakeCapture,
    on_event: Callable[[str], None] = lambda line: None,
    clock_ns: Callable[[], int] | None = None,
    **spec: Any,
) -> VideoSource:
    given = iter(captures)
    clock: Iterator[int] = iter(range(10**18, 2 * 10**18, 33_000_000))
    return open_source(
        SourceSpec(url="0", kind="v4l2", **{"backoff_initial_s": 0.0, "max_reconnects": 0, **spec}),
        source="lab/usb",
        run_id="r",
        clock_ns=clock_ns or (lambda: next(clock)),
        steady_ns=lambda: sum(capture.taken for capture in captures) * 33_000_000,
        on_event=on_event,
        capture_factory=lambda url: next(given),
    )


def items_until_lost(source: VideoSource) -> list[Any]:
    """All it gives before it is given up, which it must be."""
    items: list[Any] = []
    try:
        items.extend(source)
    except SourceLost:
        return items
    raise AssertionError("it ended without an error")


def raw(luma: NDArray[np.uint8], fourcc: str) -> NDArray[Any]:
    """What OpenCV returns with ``CAP_PROP_CONVERT_RGB`` off."""
    chroma = np.full_like(luma, 77)
    half = np.full((HEIGHT_PX // 2, WIDTH_PX), 77, np.uint8)
    jpeg: NDArray[Any] = cv2.imencode(".jpg", luma)[1]
    return {
        "YUYV": np.stack([luma, chroma], axis=-1),
        "UYVY": np.stack([chroma, luma], axis=-1),
        "NV12": np.vstack([luma, half]),
        "GREY": luma,
        "Y16 ": luma.astype(np.uint16) * 256,
        "Y10 ": luma.astype(np.uint16) * 4,
        "BGR3": np.repeat(luma[:, :, None], 3, axis=2),
        "MJPG": jpeg.reshape(1, -1),
    }[fourcc]


@pytest.mark.parametrize("fourcc", ["YUYV", "UYVY", "NV12", "GREY", "Y16 ", "Y10 ", "BGR3", "MJPG"])
def test_luma_of_every_format(fourcc: str) -> None:
    lumas = pictures(4, HEIGHT_PX, WIDTH_PX)
    images = [raw(y, fourcc) for y in lumas]
    if fourcc == "MJPG":
        lumas = [cv2.imdecode(i.ravel(), cv2.IMREAD_GRAYSCALE) for i in images]
    source = open_fake(FakeCapture(images, fourcc))
    frames = only_frames(items_until_lost(source))
    assert len(frames) == 4
    for frame, luma in zip(frames, lumas, strict=True):
        assert np.array_equal(frame.luma, luma)
    assert (source.info.width_px, source.info.height_px) == (WIDTH_PX, HEIGHT_PX)
    assert source.info.live


def test_jpeg_packets_are_the_cameras_own() -> None:
    images = [raw(y, "MJPG") for y in pictures(3, HEIGHT_PX, WIDTH_PX)]
    source = open_fake(FakeCapture(images, "MJPG"), with_packets=True)
    packets = only_packets(items_until_lost(source))
    assert source.info.packets_recordable
    assert [p.data for p in packets] == [i.tobytes() for i in images]
    assert {(p.codec, p.keyframe) for p in packets} == {("mjpeg", True)}


def test_a_broken_jpeg_is_counted_and_leaves_a_gap() -> None:
    images = [raw(y, "MJPG") for y in pictures(4, HEIGHT_PX, WIDTH_PX)]
    images[2] = np.frombuffer(b"\xff\xd8 no picture", np.uint8).reshape(1, -1)
    source = open_fake(FakeCapture(images, "MJPG"))
    frames = only_frames(items_until_lost(source))
    assert [f.header.seq for f in frames] == [0, 1, 3]
    assert "damaged frames and packets: 1" in source.loss


def test_the_drivers_clock_is_taken_where_it_moves() -> None:
    images = [raw(y, "YUYV") for y in pictures(4, HEIGHT_PX, WIDTH_PX)]
    times_ms = [5000.0, 5033.366, 5066.733, 5100.1]
    source = open_fake(FakeCapture(images, times_ms=times_ms))
    frames = only_frames(items_until_lost(source))
    assert [f.header.pts_ns for f in frames] == [round(t * 1000) * 1000 for t in times_ms]
    assert source.warnings == []


def test_otherwise_the_time_of_arrival_from_the_first() -> None:
    images = [raw(y, "YUYV") for y in pictures(4, HEIGHT_PX, WIDTH_PX)]
    source = open_fake(FakeCapture(images))
    frames = only_frames(items_until_lost(source))
    assert [f.header.pts_ns for f in frames] == [n * 33_000_000 for n in range(4)]
    assert frames[0].header.arrival_time_ns == 10**18
    assert any("no times" in line for line in source.warnings)


def test_a_host_clock_that_is_set_moves_no_picture() -> None:
    images = [raw(y, "YUYV") for y in pictures(4, HEIGHT_PX, WIDTH_PX)]
    wall = iter([10**18, 10**18, 5, 6, *[2 * 10**18] * 9])
    frames = only_frames(items_until_lost(open_fake(FakeCapture(images), clock_ns=wall.__next__)))
    assert [f.header.pts_ns for f in frames] == [n * 33_000_000 for n in range(4)]
    assert {f.header.epoch for f in frames} == {0}
    assert [f.header.arrival_time_ns for f in frames] == [10**18, 10**18, 5, 6]


def test_a_camera_that_is_not_there_is_one_clear_error() -> None:
    with pytest.raises(SourceLost, match="can't be opened") as caught:
        open_fake(FakeCapture([], opened=False))
    assert caught.value.hint
    with pytest.raises(SourceLost, match="no such camera"):
        open_source(
            SourceSpec(url="/dev/video987", kind="v4l2"),
            source="a/b",
            run_id="r",
            clock_ns=lambda: 0,
        )


def test_a_stall_is_noticed_and_the_camera_opened_again() -> None:
    images = [raw(y, "GREY") for y in pictures(5, HEIGHT_PX, WIDTH_PX)]
    hang = Event()
    stalled = FakeCapture(images, "GREY", hang=hang)
    events: list[str] = []
    source = open_fake(
        stalled, FakeCapture(images, "GREY"), on_event=events.append,
        read_timeout_s=0.2, max_reconnects=1,
    )  # fmt: skip
    frames = []
    for item in source:
        frames.append(item)
        if item.header.epoch == 1 and item.header.seq == 3:
            source.close()
    assert [(f.header.epoch, f.header.seq) for f in frames] == [
        *((0, n) for n in range(5)),
        *((1, n) for n in range(4)),
    ]
    assert "no picture for 0.2 s" in events[0]
    assert "connected" in events[1]
    assert "lost the source once" in source.loss
    assert not stalled.released.is_set()  # its thread is still inside read()
    hang.set()
    assert stalled.released.wait(30)
