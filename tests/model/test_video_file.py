from __future__ import annotations

import resource
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from rsenf.errors import RecordingError, UsageError
from rsenf.model import (
    CaptureModel,
    Codec,
    Effect,
    FrameStream,
    Shutter,
    render_frames,
    synthetic_grid,
    write_video,
)
from rsenf.model.effects.delivery import FrameDrop, FrameDuplicate, TimestampJitter
from rsenf.model.effects.shutter import VariableFrameRate

GRID = synthetic_grid(1, 30)


def clip(frame_rate: Fraction = Fraction(30000, 1001), *effects: Effect) -> FrameStream:
    shutter = Shutter(rows=120, columns=160, frame_rate=frame_rate)
    return render_frames(CaptureModel(shutter=shutter, effects=effects), GRID, 1.5, 3)


def read(path: Path) -> tuple[list[Fraction], list[np.ndarray], str]:
    times, planes = [], []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            times.append(frame.pts * frame.time_base)
            plane = frame.planes[0]
            pixels = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)
            planes.append(pixels[: frame.height, : frame.width].copy())
        return times, planes, container.streams.video[0].codec_context.name


@pytest.mark.parametrize(
    ("suffix", "codec"), [(".mp4", "h264"), (".mov", "h265"), (".avi", "mjpeg")]
)
@pytest.mark.parametrize(
    "frame_rate", [Fraction(30000, 1001), Fraction(25), Fraction(24000, 1001), Fraction(60)]
)
def test_times_are_exact(tmp_path: Path, suffix: str, codec: str, frame_rate: Fraction) -> None:
    frames = clip(frame_rate)
    path = tmp_path / f"clip{suffix}"
    assert write_video(path, frames, Codec(name=codec)) == frames.frames
    assert read(path)[0] == [n / frame_rate for n in range(frames.frames)]


@pytest.mark.parametrize(
    "effect",
    [
        FrameDrop(drops_per_min=600, retimed=False),
        FrameDuplicate(duplicates_per_min=600),
        TimestampJitter(jitter_s=0.002),
        VariableFrameRate(rate_ratio=0.05, time_constant_s=0.2),
    ],
)
def test_times_that_aren_t_regular(tmp_path: Path, effect: Effect) -> None:
    frames = clip(Fraction(30000, 1001), effect)
    write_video(tmp_path / "clip.mp4", frames, Codec(preset="medium"))  # with B frames
    wanted = [pts * frames.time_base for pts, _ in frames]
    assert wanted != [n * Fraction(1001, 30000) for n in range(45)]
    assert read(tmp_path / "clip.mp4")[0] == wanted


@pytest.mark.parametrize("suffix", [".mkv", ".webm"])
def test_matroska_keeps_milliseconds(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"clip{suffix}"
    frames = clip()
    write_video(path, frames, Codec(name="vp9"))
    times = np.array(read(path)[0], dtype=float)
    assert times == pytest.approx(np.arange(frames.frames) * 1001 / 30000, abs=0.00051)


@pytest.mark.parametrize("name", ["h264", "h265", "vp9"])
def test_lossless_is_what_was_rendered(tmp_path: Path, name: str) -> None:
    path = tmp_path / "clip.mkv"
    write_video(path, clip(), Codec(name=name, lossless=True))
    _, planes, _ = read(path)
    assert all(np.array_equal(y, got) for (_, y), got in zip(clip(), planes, strict=True))


@pytest.mark.parametrize(
    ("name", "decoder"),
    [("h264", "h264"), ("h265", "hevc"), ("vp9", "libvpx-vp9"), ("mjpeg", "mjpeg")],
)
@pytest.mark.parametrize("bitrate_bps", [None, 200_000])
def test_each_codec_keeps_the_picture(
    tmp_path: Path, name: str, decoder: str, bitrate_bps: int | None
) -> None:
    path = tmp_path / "clip.mp4"
    write_video(path, clip(), Codec(name=name, bitrate_bps=bitrate_bps))
    _, planes, codec = read(path)
    assert codec in (decoder, name)
    for (_, y), got in zip(clip(), planes, strict=True):
        assert np.mean(got) == pytest.approx(np.mean(y), abs=4)


def test_the_bit_rate_is_met(tmp_path: Path) -> None:
    sizes = []
    for bitrate_bps in (400_000, 1_200_000):
        path = tmp_path / f"{bitrate_bps}.mp4"
        write_video(path, clip(), Codec(bitrate_bps=bitrate_bps))
        sizes.append(path.stat().st_size * 8 / 1.5)
    assert sizes == pytest.approx([400_000, 1_200_000], rel=0.4)


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        write_video(tmp_path / name, clip(), Codec(bitrate_bps=150_000))
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_key_frames_come_as_often_as_asked(tmp_path: Path) -> None:
    path = tmp_path / "clip.mp4"
    write_video(path, clip(), Codec(gop_frames=15))
    with av.open(str(path)) as container:
        keys = [p.pts * p.time_base for p in container.demux(video=0) if p.is_keyframe and p.size]
    assert keys == [n * Fraction(1001, 30000) for n in (0, 15, 30)]


@pytest.mark.parametrize(("name", "off", "on"), [("h264", 0, 2), ("h265", 0, 1)])
def test_weighted_prediction_is_as_asked(tmp_path: Path, name: str, off: int, on: int) -> None:
    # Both encoders write their settings into the stream.
    for asked, written in ((False, off), (True, on)):
        path = tmp_path / f"{asked}.mp4"
        codec = Codec(name=name, preset="medium", weighted_prediction=asked)
        write_video(path, clip(), codec)
        told = path.read_bytes()
        setting = {"h264": f"weightp={written}", "h265": " weightp" if written else "no-weightp"}
        assert setting[name].encode() in told


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, ValueError])
def test_an_interruption_leaves_nothing_and_harms_nothing(
    tmp_path: Path, interruption: type[BaseException]
) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(b"what stood here before")

    def stop(done: int) -> None:
        if done == 20:
            raise interruption

    with pytest.raises(interruption):
        write_video(path, clip(), Codec(), stop)
    assert [p.name for p in tmp_path.iterdir()] == ["clip.mp4"]
    assert path.read_bytes() == b"what stood here before"


def test_a_refused_write_is_one_clear_error_and_leaves_nothing(tmp_path: Path) -> None:
    # A limit on the size of files stands for a full disk.
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(RecordingError, match=r"can't write .*clip\.mp4: File too large"):
            write_video(tmp_path / "clip.mp4", clip(), Codec(lossless=True))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file or directory"):
        write_video(tmp_path / "nowhere" / "clip.mp4", clip(), Codec())


@pytest.mark.parametrize(
    ("name", "codec", "says"),
    [
        ("clip.txt", Codec(), "not a video file's name"),
        ("clip.webm", Codec(), "it holds vp9"),
        ("clip.avi", Codec(), "it holds mjpeg"),
        ("clip.mp4", Codec(name="mjpeg", lossless=True), "can't be had from mjpeg"),
        ("clip.mp4", Codec(lossless=True, bitrate_bps=100_000), "excludes codec.bitrate_bps"),
        ("clip.mp4", Codec(name="vp9", weighted_prediction=True), "isn't known to vp9"),
    ],
)
def test_what_can_t_be_written(tmp_path: Path, name: str, codec: Codec, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        write_video(tmp_path / name, clip(), codec)
    assert list(tmp_path.iterdir()) == []


def test_odd_sizes_are_refused(tmp_path: Path) -> None:
    model = CaptureModel(shutter=Shutter(rows=121, columns=160))
    with pytest.raises(UsageError, match="160x121 can't be encoded"):
        write_video(tmp_path / "clip.mp4", render_frames(model, GRID, 1.0, 1), Codec())
