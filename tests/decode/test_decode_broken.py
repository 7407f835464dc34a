"""Bad input: what can be decoded is, what was lost is said, the rest is one clear error."""

from __future__ import annotations

import errno
import io
import os
from pathlib import Path

import av
import numpy as np
import pytest
from decode_clips import NTSC, cut_short, make_clip, make_sound, only_frames, pictures, source_of

from rsenf.decode.container import _segment_end, lacks_index, missing_bytes
from rsenf.errors import EXIT_FAILED, EXIT_USAGE, InputError, RsenfError, UsageError

FRONT = {"movflags": "faststart"}
FRAGMENTS = {"movflags": "frag_keyframe+empty_moov"}


@pytest.mark.parametrize(
    ("encoder", "suffix", "options"),
    [
        ("libx264", "mp4", FRONT),
        ("libx264", "mov", FRONT),
        ("libx264", "mp4", FRAGMENTS),
        ("libx264", "mkv", {}),
        ("libvpx-vp9", "webm", {}),
        ("mjpeg", "avi", {}),
    ],
)
def test_a_truncated_file_gives_what_is_there_and_says_so(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    encoder: str,
    suffix: str,
    options: dict[str, str],
) -> None:
    lumas = pictures(60)
    whole = make_clip(tmp_path / f"whole.{suffix}", lumas, encoder, container_options=options)
    part = cut_short(whole, tmp_path / f"part.{suffix}")
    with source_of(whole) as source:
        expected = only_frames(source)
        assert source.loss == ""
    with source_of(part) as source:
        frames = only_frames(source)
    assert 20 < len(frames) < 50
    for got, want in zip(frames[:20], expected[:20], strict=True):
        assert np.array_equal(got.luma, want.luma)
        assert got.header.pts_ns == want.header.pts_ns
    assert "cut short" in source.loss
    assert "decoded up to" in source.loss
    assert "\n" not in source.loss
    assert capfd.readouterr() == ("", "")


def test_several_recordings_in_one_file_end_with_the_first(tmp_path: Path) -> None:
    one = make_clip(tmp_path / "one.ts", pictures(60), "libx264", container_format="mpegts")
    (tmp_path / "two.ts").write_bytes(2 * one.read_bytes())
    with source_of(tmp_path / "two.ts") as source:
        frames = only_frames(source)
    times_ns = [frame.header.pts_ns for frame in frames]
    assert 50 < len(frames) <= 60
    assert times_ns == sorted(times_ns)
    assert "its time stamps jump back; decoded up to" in source.loss


def test_damaged_frames_are_left_out_counted_and_keep_their_numbers(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(60), options={"qp": "20"})
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(3)
    for at in rng.integers(data.index(b"mdat") + 3000, data.index(b"moov"), 12):
        data[at] ^= 0xFF
    path.write_bytes(data)
    with source_of(path) as source:
        frames = only_frames(source)
    numbers = [f.header.seq for f in frames]
    assert len(frames) < 60
    assert "damaged" in source.loss
    assert numbers == sorted(set(numbers))
    assert [f.header.pts_ns for f in frames] == sorted({f.header.pts_ns for f in frames})
    assert capfd.readouterr() == ("", "")


def test_a_damaged_packet_shifts_no_later_time(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.avi", pictures(30), options={"g": "1"})
    with av.open(str(path)) as container:
        packets = [p for p in container.demux(video=0) if p.size]
        start, size = packets[10].pos, packets[10].size
    data = bytearray(path.read_bytes())
    data[start : start + size] = bytes(size)
    path.write_bytes(data)
    with source_of(path) as source:
        times_ns = [f.header.pts_ns for f in only_frames(source)]
    whole = [round(n / NTSC * 1_000_000_000) for n in range(30)]
    assert times_ns == whole[:10] + whole[11:]
    assert "damaged packets: 1" in source.loss


def error_of(path: Path) -> RsenfError:
    with pytest.raises(RsenfError) as caught:
        source_of(path)
    assert "\n" not in str(caught.value)
    assert path.name in caught.value.message
    assert caught.value.hint
    return caught.value


def test_what_is_no_video_is_one_clear_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = make_clip(tmp_path / "whole.mp4", pictures(30))
    unfinished = cut_short(whole, tmp_path / "unfinished.mp4")
    text = tmp_path / "text.mp4"
    text.write_text("hello world\n" * 50)
    notes = tmp_path / "notes.txt"  # FFmpeg would draw it as pictures
    notes.write_text("hello world\n" * 50)
    listing = tmp_path / "list.mp4"  # FFmpeg would open what it names
    listing.write_text("ffconcat version 1.0\nfile 'whole.mp4'\n")
    session = tmp_path / "session.mp4"  # FFmpeg would wait for packets from the network
    session.write_text("v=0\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 26\n")
    noise = tmp_path / "noise.mp4"
    noise.write_bytes(np.random.default_rng(1).bytes(10_000))
    empty = tmp_path / "empty.mp4"
    empty.touch()
    sound = make_sound(tmp_path / "sound.mp4")
    photograph = make_clip(
        tmp_path / "photograph.mjpeg", pictures(1), "mjpeg", container_format="mjpeg"
    )
    for path in (unfinished, text, notes, listing, session, noise, empty, sound, photograph):
        error = error_of(path)
        assert isinstance(error, InputError)
        assert error.exit_code == EXIT_FAILED
    assert "never finished" in error_of(unfinished).message
    assert "empty" in error_of(empty).message
    assert "only sound" in error_of(sound).message
    assert capfd.readouterr() == ("", "")


def test_a_video_without_a_single_good_frame_is_an_error(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(3), container_options=FRONT)
    data = bytearray(path.read_bytes())
    start = data.index(b"mdat") + 4
    data[start:] = bytes(len(data) - start)
    path.write_bytes(data)
    assert "no frame can be decoded" in error_of(path).message


def test_damaged_parameters_are_one_clear_error(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(5))
    content = bytearray(path.read_bytes())
    at = content.index(b"avcC") + 4
    content[at + 6 : at + 8] = b"\xff\xff"  # the length of the first set
    path.write_bytes(content)
    assert "no frame can be decoded" in error_of(path).message


def test_a_missing_file_or_a_directory_is_a_usage_error(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.mp4", tmp_path):
        error = error_of(path)
        assert isinstance(error, UsageError)
        assert error.exit_code == EXIT_USAGE


def test_a_change_of_size_ends_the_file(tmp_path: Path) -> None:
    small = make_clip(tmp_path / "a.h264", pictures(10), container_format="h264")
    large = make_clip(tmp_path / "b.h264", pictures(10, 96, 128), container_format="h264")
    both = tmp_path / "both.h264"
    both.write_bytes(small.read_bytes() + large.read_bytes())
    with source_of(both) as source:
        frames = only_frames(source)
    assert {f.luma.shape for f in frames if f.luma is not None} == {(48, 64)}
    assert len(frames) == 10
    assert "size" in source.loss


def test_times_that_go_back_are_told(tmp_path: Path) -> None:
    once = make_clip(tmp_path / "a.ts", pictures(10))
    twice = tmp_path / "twice.ts"
    twice.write_bytes(2 * once.read_bytes())
    with source_of(twice) as source:
        frames = only_frames(source)
    assert len(frames) == 20
    assert any("not later" in line for line in source.warnings)


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "webm", "avi"])
def test_the_number_of_missing_bytes_is_exact(tmp_path: Path, suffix: str) -> None:
    encoder = "libvpx-vp9" if suffix == "webm" else "mjpeg"
    whole = make_clip(
        tmp_path / f"whole.{suffix}",
        pictures(10),
        encoder,
        container_options=FRONT if suffix in ("mp4", "mov") else {},
    )
    data = whole.read_bytes()
    assert missing_bytes(whole) == 0
    assert not lacks_index(whole)
    for missing in (1, 10, 1000, len(data) // 2):
        part = tmp_path / f"part.{suffix}"
        part.write_bytes(data[:-missing])
        assert missing_bytes(part) == missing


def test_long_boxes_are_followed(tmp_path: Path) -> None:
    path = tmp_path / "long.mp4"
    head = (8).to_bytes(4, "big") + b"ftyp"
    media = (1).to_bytes(4, "big") + b"mdat" + (1 << 33).to_bytes(8, "big")
    path.write_bytes(head + media + bytes(100))
    assert missing_bytes(path) == (1 << 33) - 16 - 100
    assert lacks_index(path)


class ShortDisk(io.BytesIO):
    """A file on a file system that has no offsets beyond a terabyte."""

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        if offset > 1 << 40:
            raise OSError(errno.EINVAL, "Invalid argument")
        return super().seek(offset, whence)


def test_an_element_longer_than_any_file_is_followed_nowhere() -> None:
    data = bytes.fromhex("1a45dfa3 01fffffffffffffe") + bytes(100)
    assert _segment_end(ShortDisk(data), len(data)) == 0


@pytest.mark.parametrize("suffix", ["mp4", "mov", "fragments.mp4"])
@pytest.mark.parametrize(
    "junk",
    [
        (1_524_699_063).to_bytes(4) + b"\x9a\x03zZ" + bytes(100),  # a kind that nobody knows
        (1).to_bytes(4) + b"gps " + (1 << 60).to_bytes(8) + bytes(100),
        (5000).to_bytes(4) + b"free" + bytes(100),
        b"some text that is no box",
    ],
)
def test_junk_after_the_pictures_is_nothing_lost(tmp_path: Path, suffix: str, junk: bytes) -> None:
    lumas = pictures(20)
    options = FRAGMENTS if "fragments" in suffix else FRONT
    path = make_clip(tmp_path / f"clip.{suffix}", lumas, container_options=options)
    path.write_bytes(path.read_bytes() + junk)
    with source_of(path) as source:
        frames = only_frames(source)
    assert len(frames) == 20
    assert source.loss == ""


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF])
@pytest.mark.parametrize("index", [True, False])
def test_an_avi_whose_writer_never_set_its_size_is_whole(
    tmp_path: Path, size: int, index: bool
) -> None:
    lumas = pictures(20)
    path = make_clip(tmp_path / "clip.avi", lumas, "ffv1")
    data = bytearray(path.read_bytes())
    movi = data.index(b"movi") - 4
    data[4:8] = data[movi : movi + 4] = size.to_bytes(4, "little")
    path.write_bytes(data if index else data[: data.index(b"idx1")])
    with source_of(path) as source:
        frames = only_frames(source)
    assert all(np.array_equal(f.luma, y) for f, y in zip(frames, lumas, strict=True))
    assert source.loss == ""


def test_a_stream_written_without_lengths_can_not_tell(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "live.mkv", pictures(10), container_options={"live": "1"})
    assert missing_bytes(cut_short(path, tmp_path / "part.mkv")) == 0


def test_a_cover_picture_is_no_video(tmp_path: Path) -> None:
    path = tmp_path / "song.mp4"
    cover = make_clip(tmp_path / "cover.avi", pictures(1), "mjpeg")
    with (
        av.open(str(make_sound(tmp_path / "sound.mp4"))) as sound,
        av.open(str(cover)) as image,
        av.open(str(path), "w") as out,
    ):
        song = out.add_stream_from_template(sound.streams.audio[0])
        art = out.add_stream_from_template(image.streams.video[0])
        art.disposition = av.stream.Disposition.attached_pic
        for source, target in ((image, art), (sound, song)):
            for packet in source.demux():
                if packet.size:
                    packet.stream = target
                    out.mux(packet)
    assert "only sound" in error_of(path).message
