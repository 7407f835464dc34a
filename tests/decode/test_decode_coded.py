"""Packets decoded by themselves, and decoders that are dropped in the middle of their work."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from rsenf.decode.packets import PacketDecoder
from rsenf.decode.stream import luma_plane

FRAMES = 40


@pytest.fixture(scope="module")
def packets(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, bytes]]:
    """A short film with B frames, packet by packet."""
    path = tmp_path_factory.mktemp("coded") / "film.h264"
    rng = np.random.default_rng(1)
    with av.open(str(path), "w", format="h264") as out:
        stream = out.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p"
        stream.options = {"x264-params": "b-adapt=0:bframes=2:scenecut=0"}
        for _ in range(FRAMES):
            picture = rng.integers(0, 255, (96, 128, 3), np.uint8)
            out.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        out.mux(stream.encode(None))
    with av.open(str(path)) as film:
        return [(n, bytes(p)) for n, p in enumerate(film.demux(video=0)) if p.size]


def test_each_picture_comes_with_what_its_packet_came_with(
    packets: list[tuple[int, bytes]], tmp_path: Path
) -> None:
    decoder = PacketDecoder("h264")
    found = [one for n, data in packets for one in decoder.decode(data, n)] + decoder.rest()
    assert sorted(tag for _, tag in found) == list(range(FRAMES))
    assert [tag for _, tag in found] != list(range(FRAMES))  # coded in another order
    raw = tmp_path / "all.h264"
    raw.write_bytes(b"".join(data for _, data in packets))
    with av.open(str(raw)) as film:
        pictures = [luma_plane(p).copy() for p in film.decode(video=0)]
    assert all(
        np.array_equal(luma_plane(picture), other)
        for (picture, _), other in zip(found, pictures, strict=True)
    )


def test_without_times_tags_come_in_the_order_of_the_packets(
    packets: list[tuple[int, bytes]],
) -> None:
    decoder = PacketDecoder("h264")
    found = [one for n, data in packets for one in decoder.decode(data, n, pts_ns=None)]
    assert [tag for _, tag in found + decoder.rest()] == list(range(FRAMES))
    assert not decoder.contradicts


def test_times_of_decoding_are_told_from_those_of_showing(
    packets: list[tuple[int, bytes]],
) -> None:
    decoder = PacketDecoder("h264")
    found = [one for n, data in packets for one in decoder.decode(data, n)] + decoder.rest()
    shown = [tag for _, tag in found]
    of_decoding, of_showing = PacketDecoder("h264"), PacketDecoder("h264")
    for n, data in packets:
        of_decoding.decode(data, n, pts_ns=n)
        of_showing.decode(data, n, pts_ns=shown.index(n))
    of_decoding.rest()
    of_showing.rest()
    assert (of_decoding.contradicts, of_showing.contradicts) == (True, False)


DROPPED = """
import pickle, sys
from rsenf.decode.packets import PacketDecoder
packets = pickle.load(sys.stdin.buffer)
for n in range(200):
    decoder = PacketDecoder("h264")
    for number, data in packets[: 5 + n % 30]:
        decoder.decode(data, number)
    del decoder
"""


def test_one_that_is_dropped_at_work_does_not_hang(packets: list[tuple[int, bytes]]) -> None:
    done = subprocess.run([sys.executable, "-c", DROPPED], input=pickle.dumps(packets), check=False)
    assert done.returncode == 0


@pytest.mark.parametrize("codec", ["png", "mjpeg"])
def test_stills_are_each_for_itself(codec: str) -> None:
    rng = np.random.default_rng(2)
    wanted = [rng.integers(0, 255, (32, 48), np.uint8) for _ in range(3)]
    coded = [cv2.imencode(".png" if codec == "png" else ".jpg", w)[1].tobytes() for w in wanted]
    decoder = PacketDecoder(codec)
    found = [one for n, data in enumerate(coded) for one in decoder.decode(data, n)]
    assert [tag for _, tag in found] == [0, 1, 2]
    assert decoder.rest() == []
    if codec == "png":
        assert all(
            np.array_equal(luma_plane(p), w) for (p, _), w in zip(found, wanted, strict=True)
        )
