"""Every promised codec and container gives the pictures that went in, at their times."""

from __future__ import annotations

import shutil
import subprocess
from fractions import Fraction
from pathlib import Path
from threading import Event, Thread

import cv2
import numpy as np
import pytest
from decode_clips import (
    CONTAINERS,
    LOSSLESS,
    NTSC,
    frames_of,
    lumas_of,
    make_clip,
    only_frames,
    only_packets,
    packet_times_ns,
    pictures,
    source_of,
)

from rsenf.decode import SourceSpec, open_source
from rsenf.errors import UsageError
from rsenf.messages import Frame

needs_ffmpeg = pytest.mark.skipif(
    not (shutil.which("ffmpeg") and shutil.which("ffprobe")), reason="needs ffmpeg and ffprobe"
)
B_FRAMES = {
    "libx264": {"qp": "20", "bf": "3", "b_strategy": "0"},
    "libx265": {"x265-params": "lossless=1:log-level=none:bframes=3:b-adapt=0"},
}


def same(frames: list[Frame], lumas: list[np.ndarray]) -> bool:
    return len(frames) == len(lumas) and all(
        np.array_equal(f.luma, y) for f, y in zip(frames, lumas, strict=True) if f.luma is not None
    )


@pytest.mark.parametrize(("encoder", "suffix"), CONTAINERS)
def test_pictures_and_times_are_those_that_went_in(
    tmp_path: Path, encoder: str, suffix: str
) -> None:
    lumas = pictures(20)
    path = make_clip(tmp_path / f"clip.{suffix}", lumas, encoder)

    with source_of(path) as source:
        frames = only_frames(source)

    assert same(frames, lumas if encoder in LOSSLESS else lumas_of(path))
    # Matroska keeps whole milliseconds; AVI and MP4 keep 1001/30000 s exactly.
    period = 1 / NTSC
    step_ns = 1_000_000 if suffix in ("mkv", "webm") else 1
    half = Fraction(1, 2)
    expected = [int(n * period * 1_000_000_000 / step_ns + half) * step_ns for n in range(20)]
    assert [f.header.pts_ns for f in frames] == expected
    assert [f.header.seq for f in frames] == list(range(20))
    assert all(f.header.frame_first == f.header.frame_last == f.header.seq for f in frames)
    assert frames[0].codec in ("h264", "hevc", "vp9", "mjpeg", "ffv1")
    assert frames[0].keyframe
    assert frames[0].declared_rate_hz == pytest.approx(29.97, abs=0.01)
    assert source.loss == ""
    assert source.info.frame_count == 20


@pytest.mark.parametrize("encoder", ["libx264", "libvpx-vp9", "mjpeg"])
@pytest.mark.parametrize("width_px", [1366, 854, 720, 66])
def test_padded_lines_are_cut_to_the_picture(tmp_path: Path, encoder: str, width_px: int) -> None:
    lumas = pictures(3, 34, width_px)
    path = make_clip(tmp_path / "clip.mkv", lumas, encoder)
    frames = frames_of(path)
    assert frames[0].width_px == width_px
    assert frames[0].height_px == 34
    assert same(frames, lumas if encoder in LOSSLESS else lumas_of(path))


@pytest.mark.parametrize("encoder", ["libx264", "libx265"])
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_variable_frame_rate_with_b_frames_keeps_order_and_times(
    tmp_path: Path, suffix: str, encoder: str
) -> None:
    lumas = pictures(30)
    rng = np.random.default_rng(5)
    ticks = np.cumsum(rng.integers(20, 60, 30)).tolist()
    path = make_clip(
        tmp_path / f"clip.{suffix}",
        lumas,
        encoder,
        ticks=ticks,
        time_base=Fraction(1, 1000),
        options=B_FRAMES[encoder],
    )
    with source_of(path) as source:
        frames = only_frames(source)
    assert "B frames" in source.info.packets_reason
    # x264 makes no B frames without loss; x265 does.
    assert same(frames, lumas if encoder == "libx265" else lumas_of(path))
    times_ns = [f.header.pts_ns for f in frames]
    assert times_ns == packet_times_ns(path)
    assert [t - times_ns[0] for t in times_ns] == [(t - ticks[0]) * 1_000_000 for t in ticks]


def test_threads_change_nothing(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(30))
    one, many = frames_of(path, threads=1), frames_of(path, threads=0)
    assert same(one, [f.luma for f in many if f.luma is not None])
    assert [f.header.pts_ns for f in one] == [f.header.pts_ns for f in many]


def test_avi_with_b_frames_is_timed_by_decoding_order(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.avi", pictures(30), options=B_FRAMES["libx264"])
    with source_of(path) as source:
        frames = only_frames(source)
    assert "B frames" in source.info.packets_reason
    assert same(frames, lumas_of(path))
    assert [f.header.pts_ns for f in frames] == [round(n / NTSC * 1_000_000_000) for n in range(30)]
    assert any("AVI" in line for line in source.warnings)


def test_a_bare_stream_is_timed_by_its_declared_rate_and_says_so(tmp_path: Path) -> None:
    lumas = pictures(30)
    path = make_clip(tmp_path / "clip.h264", lumas, container_format="h264")
    with source_of(path) as source:
        frames = only_frames(source)
    assert same(frames, lumas)
    assert frames[-1].header.pts_ns == round(29 / NTSC * 1_000_000_000)
    assert any("no frame times" in line for line in source.warnings)
    assert source.loss == ""


@pytest.mark.parametrize("suffix", ["mjpeg", "jpgs"])
def test_jpegs_one_after_the_other_are_a_film(tmp_path: Path, suffix: str) -> None:
    path = make_clip(tmp_path / f"clip.{suffix}", pictures(30), "mjpeg", container_format="mjpeg")
    with source_of(path, with_packets=True) as source:
        items = list(source)
    frames = only_frames(items)
    assert same(frames, lumas_of(make_clip(tmp_path / "clip.avi", pictures(30), "mjpeg")))
    assert [f.header.pts_ns for f in frames] == [40_000_000 * n for n in range(30)]
    assert {item.header.rate_basis for item in items} == {"assumed"}
    assert frames[0].declared_rate_hz == 0.0
    assert any("25 frames a second are assumed" in line for line in source.warnings)
    assert source.loss == ""


@pytest.mark.parametrize(
    ("suffix", "basis"),
    [("mp4", ""), ("mkv", ""), ("avi", "declared"), ("y4m", "declared"), ("h264", "declared")],
)
def test_what_frame_times_rest_on_is_told(tmp_path: Path, suffix: str, basis: str) -> None:
    encoder = "libx264" if suffix != "y4m" else "wrapped_avframe"
    frames = frames_of(make_clip(tmp_path / f"clip.{suffix}", pictures(4), encoder))
    assert {f.header.rate_basis for f in frames} == {basis}
    assert frames[0].declared_rate_hz == pytest.approx(float(NTSC), rel=1e-4)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "avi", "h264", "mjpeg"])
def test_frames_are_counted_at_a_rate_that_is_given(tmp_path: Path, suffix: str) -> None:
    """In the order in which they are shown, whatever times the file holds."""
    encoder = "mjpeg" if suffix == "mjpeg" else "libx264"
    options = B_FRAMES.get(encoder)
    path = make_clip(tmp_path / f"clip.{suffix}", pictures(30), encoder, options=options)
    with source_of(path, with_packets=True, frame_rate_hz=23.5) as source:
        items = list(source)
    frames = only_frames(items)
    assert same(frames, lumas_of(path))
    expected = [round(n / 23.5 * 1_000_000_000) for n in range(30)]
    assert [f.header.pts_ns for f in frames] == expected
    assert [p.header.pts_ns for p in only_packets(items)] == expected
    assert all(p.untimed for p in only_packets(items))
    assert {item.header.rate_basis for item in items} == {"given"}
    assert any("23.5" in line for line in source.warnings)


def test_a_rate_is_for_files_and_above_zero() -> None:
    live = SourceSpec(url="rtsp://a/b", kind="rtsp", frame_rate_hz=25.0)
    with pytest.raises(UsageError, match="times of its own"):
        open_source(live, source="a/b", run_id="", clock_ns=lambda: 0)
    with pytest.raises(UsageError, match="frame rate of 0 Hz"):
        source_of(Path("clip.mp4"), frame_rate_hz=0.0)


def test_the_plane_is_a_read_only_view_that_outlives_the_source(tmp_path: Path) -> None:
    lumas = pictures(40)
    frames = frames_of(make_clip(tmp_path / "clip.mp4", lumas))
    luma = frames[0].luma
    assert luma is not None
    with pytest.raises(ValueError, match="read-only"):
        luma[0, 0] = 1
    assert same(frames, lumas)  # held since, while the decoder went on
    sums = cv2.reduce(luma, 1, cv2.REDUCE_SUM, dtype=cv2.CV_32F)
    assert np.array_equal(sums[:, 0], lumas[0].sum(axis=1))


@pytest.mark.parametrize(
    ("matrix", "clockwise_deg"),
    [((0, 1, -1, 0), 90), ((-1, 0, 0, -1), 180), ((0, -1, 1, 0), 270), ((1, 0, 0, 1), 0)],
)
def test_rotation_is_told_and_the_plane_left_as_coded(
    tmp_path: Path, matrix: tuple[int, int, int, int], clockwise_deg: int
) -> None:
    lumas = pictures(4)
    path = make_clip(tmp_path / "clip.mp4", lumas)
    data = bytearray(path.read_bytes())
    # ISO/IEC 14496-12, 8.3.2: the matrix stands 40 bytes into the track header, 16.16 fixed point.
    start = data.index(b"tkhd") + 44
    for place, value in zip((0, 1, 3, 4), matrix, strict=True):
        at = start + 4 * place
        data[at : at + 4] = (value << 16).to_bytes(4, "big", signed=True)
    path.write_bytes(data)

    with source_of(path) as source:
        frames = only_frames(source)
    assert source.info.rotation_deg == clockwise_deg
    assert frames[0].rotation_deg == clockwise_deg
    assert same(frames, lumas)


def test_camera_time_comes_from_the_container(tmp_path: Path) -> None:
    made = {"creation_time": "2024-08-19T15:26:02.000000Z"}
    path = make_clip(tmp_path / "clip.mp4", pictures(4), metadata=made)
    frames = frames_of(path)
    utc_ns = 1_724_081_162_000_000_000
    assert [f.header.camera_time_ns for f in frames] == [
        utc_ns + f.header.pts_ns - frames[0].header.pts_ns for f in frames
    ]
    unknown = frames_of(make_clip(tmp_path / "plain.mp4", pictures(2)))
    assert unknown[0].header.camera_time_ns == 0


def test_frames_stop_when_closed_or_told_to(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(60))
    with source_of(path) as source:
        items = iter(source)
        next(items)
        closing = Thread(target=source.close)
        closing.start()
        closing.join()
        assert list(items) == []

    stop = Event()
    spec = SourceSpec(url=str(path), kind="file")
    source = open_source(spec, source="a/b", run_id="r", clock_ns=lambda: 0, stop=stop)
    items = iter(source)
    next(items)
    stop.set()
    assert list(items) == []


def test_a_constant_arrival_clock_is_carried(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(20))
    spec = SourceSpec(url=str(path), kind="file")
    with open_source(spec, source="a/b", run_id="r", clock_ns=lambda: 7) as source:
        assert {f.header.arrival_time_ns for f in only_frames(source)} == {7}


@pytest.mark.external
@needs_ffmpeg
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_ffmpeg_and_ffprobe_agree(tmp_path: Path, suffix: str) -> None:
    path = make_clip(
        tmp_path / f"clip.{suffix}", pictures(30, 34, 854), options=B_FRAMES["libx264"]
    )
    frames = frames_of(path)
    raw = subprocess.run(
        [
            *("ffmpeg", "-v", "error", "-i", str(path), "-fps_mode", "passthrough"),
            *("-vf", "extractplanes=y", "-f", "rawvideo", "-pix_fmt", "gray", "-"),
        ],
        check=True,
        capture_output=True,
    ).stdout
    assert same(frames, list(np.frombuffer(raw, np.uint8).reshape(-1, 34, 854)))
    listed = subprocess.run(
        [
            *("ffprobe", "-v", "error", "-select_streams", "v:0", "-of", "csv=p=0"),
            *("-show_entries", "frame=best_effort_timestamp_time", str(path)),
        ],
        check=True,
        capture_output=True,
        text=True,
    ).stdout.split()
    times_s = [float(line.strip(",")) for line in listed]
    assert [f.header.pts_ns / 1e9 for f in frames] == pytest.approx(times_s, abs=1e-6)


def test_packets_before_the_first_picture_have_the_cameras_time(tmp_path: Path) -> None:
    made = {"creation_time": "2024-08-19T15:26:02.000000Z"}
    path = make_clip(tmp_path / "clip.mp4", pictures(40), metadata=made)
    with source_of(path, with_packets=True) as source:
        packets = only_packets(list(source))
    offsets_ns = {p.header.camera_time_ns - p.header.pts_ns for p in packets}
    assert len(packets) == 40
    assert len(offsets_ns) == 1


def test_video_that_cant_be_recorded_is_told(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.avi", pictures(4), "mpeg4")
    with source_of(path, with_packets=True) as source:
        assert only_packets(list(source)) == []
        (told,) = (one for one in source.warnings if "recorded" in one)
    assert told == f"its video isn't recorded: {source.info.packets_reason}"
