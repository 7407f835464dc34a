"""Packets for recording: they decode, without the container, to the same pictures."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from decode_clips import frames_of, make_clip, only_frames, only_packets, pictures, source_of
from numpy.typing import NDArray

from rsenf.decode.packets import PacketDecoder, parameter_sets
from rsenf.errors import UsageError
from rsenf.messages import Frame, VideoPacket


def decoded(packets: list[VideoPacket]) -> dict[int, NDArray[np.uint8]]:
    """Luma by time, decoded from the packets' bytes alone."""
    context = av.CodecContext.create(packets[0].codec, "r")
    assert isinstance(context, av.VideoCodecContext)
    found = {}
    for packet in packets:
        raw = av.Packet(packet.data)
        raw.pts, raw.time_base = packet.header.pts_ns, Fraction(1, 1_000_000_000)
        for frame in context.decode(raw):
            found[frame.pts] = frame.to_ndarray()[: frame.height]
    for frame in context.decode(None):
        found[frame.pts] = frame.to_ndarray()[: frame.height]
    return {pts: luma for pts, luma in found.items() if pts is not None}


@pytest.mark.parametrize(
    ("encoder", "suffix", "options"),
    [
        ("libx264", "mp4", {}),
        ("libx264", "mkv", {}),
        ("libx264", "ts", {}),
        ("libx264", "mp4", {"qp": "20", "g": "8", "bf": "2", "b_strategy": "0"}),
        ("libx265", "mp4", {}),
        ("libx265", "mkv", {}),
        ("libvpx-vp9", "webm", {}),
        ("mjpeg", "mov", {}),
    ],
)
def test_recorded_packets_decode_to_the_frames_from_any_key_frame(
    tmp_path: Path, encoder: str, suffix: str, options: dict[str, str]
) -> None:
    path = make_clip(tmp_path / f"clip.{suffix}", pictures(30), encoder, options=options)
    with source_of(path, with_packets=True) as source:
        items = list(source)
    frames, packets = only_frames(items), only_packets(items)
    assert source.info.packets_recordable
    assert [p.header.seq for p in packets] == list(range(30))
    assert all(p.header.frame_first == p.header.frame_last == -1 for p in packets)
    assert sorted(p.header.pts_ns for p in packets) == [f.header.pts_ns for f in frames]

    keys = [n for n, p in enumerate(packets) if p.keyframe]
    assert len(keys) > 2
    for start in (keys[0], keys[2]):
        again = decoded(packets[start:])
        wanted = [f for f in frames if f.header.pts_ns >= packets[start].header.pts_ns]
        assert len(wanted) > 1
        for frame in wanted:
            assert np.array_equal(again[frame.header.pts_ns], frame.luma)


def test_packets_come_before_their_frames_and_change_none(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.mp4", pictures(30))
    with source_of(path, with_packets=True) as source:
        seen: set[int] = set()
        frames = []
        for item in source:
            if isinstance(item, Frame):
                assert item.header.pts_ns in seen
                frames.append(item)
            else:
                seen.add(item.header.pts_ns)
    for one, other in zip(frames, frames_of(path), strict=True):
        assert np.array_equal(one.luma, other.luma)
        assert one.header.pts_ns == other.header.pts_ns


@pytest.mark.parametrize(("codec", "sets"), [("h264", {7, 8}), ("hevc", {32, 33, 34})])
@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_every_key_frame_brings_its_parameter_sets(
    tmp_path: Path, suffix: str, codec: str, sets: set[int]
) -> None:
    encoder = "libx264" if codec == "h264" else "libx265"
    path = make_clip(tmp_path / f"clip.{suffix}", pictures(30), encoder)
    with source_of(path, with_packets=True) as source:
        packets = only_packets(list(source))
    for packet in packets:
        assert packet.codec == codec
        assert packet.data.startswith((b"\0\0\0\1", b"\0\0\1"))
        found, _ = parameter_sets(packet.data, codec)
        heads = [nal[0] for nal in found.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")[1:]]
        kinds = {h & 31 if codec == "h264" else h >> 1 & 63 for h in heads}
        assert kinds == (sets if packet.keyframe else set())


def test_parameter_sets_are_found_up_to_the_picture() -> None:
    delimiter, sps, pps = b"\0\0\0\1\x09\x10", b"\0\0\0\1\x67abc", b"\0\0\1\x68de"
    sei, idr = b"\0\0\1\x06sei", b"\0\0\1\x65picture"
    late = b"\0\0\1\x67late"
    assert parameter_sets(delimiter + sps + pps + sei + idr + late, "h264") == (sps + pps, 6)
    assert parameter_sets(delimiter + sei + idr, "h264") == (b"", 6)
    assert parameter_sets(idr, "h264") == (b"", 0)
    assert parameter_sets(b"", "h264") == (b"", 0)


def test_what_has_no_recorded_form_says_so(tmp_path: Path) -> None:
    path = make_clip(tmp_path / "clip.avi", pictures(5), "ffv1")
    with source_of(path, with_packets=True) as source:
        items = list(source)
    assert not source.info.packets_recordable
    assert "ffv1" in source.info.packets_reason
    assert len(only_frames(items)) == 5
    assert only_packets(items) == []


def test_a_codec_that_nobody_knows_is_one_clear_line() -> None:
    with pytest.raises(UsageError, match="no decoder here for video in 'foo'"):
        PacketDecoder("foo")
