"""Luma of every kind of pixel format, against what was put into the planes."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import av.filter
import numpy as np
import pytest
from decode_clips import frames_of, make_clip, pictures
from numpy.typing import NDArray

from rsenf.decode.stream import luma_plane

HEIGHT_PX, WIDTH_PX = 34, 366


def filled(pix_fmt: str, samples: NDArray[Any], *, step: int = 1, offset: int = 0) -> av.VideoFrame:
    """A frame whose luma samples stand ``step`` apart in plane 0."""
    frame = av.VideoFrame(WIDTH_PX, HEIGHT_PX, pix_fmt)
    plane = frame.planes[0]
    memory = np.frombuffer(plane, np.uint8)
    lines = memory.reshape(-1, plane.line_size).view(samples.dtype)
    lines[:] = 77  # chroma, and padding
    lines[:HEIGHT_PX, offset : offset + step * WIDTH_PX : step] = samples
    return frame


@pytest.mark.parametrize(
    "pix_fmt", ["gray", "yuv420p", "yuvj420p", "yuv422p", "yuv444p", "yuva420p", "nv12", "nv21"]
)
def test_a_plane_of_its_own_is_taken_as_it_is(pix_fmt: str) -> None:
    (luma,) = pictures(1, HEIGHT_PX, WIDTH_PX)
    frame = filled(pix_fmt, luma)
    assert np.array_equal(luma_plane(frame), luma)
    assert np.shares_memory(luma_plane(frame), luma_plane(frame))  # a view, not a copy


@pytest.mark.parametrize(("pix_fmt", "offset"), [("yuyv422", 0), ("uyvy422", 1)])
@pytest.mark.parametrize("colour_range", [0, 1, 2])
def test_interleaved_luma_is_taken_apart_unscaled(
    pix_fmt: str, offset: int, colour_range: int
) -> None:
    (luma,) = pictures(1, HEIGHT_PX, WIDTH_PX)
    frame = filled(pix_fmt, luma, step=2, offset=offset)
    frame.color_range = colour_range
    assert np.array_equal(luma_plane(frame), luma)


@pytest.mark.parametrize(
    ("pix_fmt", "bits", "shift"),
    [
        ("yuv420p10le", 10, 0),
        ("yuv422p10le", 10, 0),
        ("yuv444p10be", 10, 0),
        ("gray10le", 10, 0),
        ("yuv420p12le", 12, 0),
        ("yuv420p9le", 9, 0),
        ("p010le", 10, 6),
        ("gray16le", 16, 0),
    ],
)
def test_deep_samples_become_the_nearest_8_bit_level(pix_fmt: str, bits: int, shift: int) -> None:
    top = (1 << bits) - 1
    (deep,) = pictures(1, HEIGHT_PX, WIDTH_PX, top=top)
    stored = (deep << shift).astype(">u2" if pix_fmt.endswith("be") else "<u2")
    luma = luma_plane(filled(pix_fmt, stored))
    exact = np.minimum(deep / 2.0 ** (bits - 8), 255)
    assert luma.dtype == np.uint8
    assert np.abs(luma - exact).max() <= 0.5


@pytest.mark.parametrize("pix_fmt", ["rgb24", "bgr24", "rgba", "gbrp"])
def test_pictures_without_luma_get_the_weighted_sum_of_colours(pix_fmt: str) -> None:
    rgb = np.stack(pictures(3, HEIGHT_PX, WIDTH_PX, seed=2), axis=-1)
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgb), "rgb24").reformat(format=pix_fmt)
    luma = luma_plane(frame)
    assert luma.shape == (HEIGHT_PX, WIDTH_PX)
    assert np.abs(luma - rgb @ (0.299, 0.587, 0.114)).max() <= 2  # ITU-R BT.601


def test_bottom_up_pictures_stand_upright(tmp_path: Path) -> None:
    lumas = pictures(3, HEIGHT_PX, WIDTH_PX)

    def as_bgr(luma: NDArray[Any], pix_fmt: str) -> av.VideoFrame:
        return av.VideoFrame.from_ndarray(np.repeat(luma[:, :, None], 3, axis=2), pix_fmt)

    path = make_clip(tmp_path / "clip.avi", lumas, "rawvideo", pix_fmt="bgr24", to_frame=as_bgr)
    for frame, luma in zip(frames_of(path), lumas, strict=True):
        assert frame.luma is not None
        assert np.abs(frame.luma.astype(int) - luma).max() <= 1


def test_lines_stored_backwards_stand_upright() -> None:
    (luma,) = pictures(1, HEIGHT_PX, WIDTH_PX)
    flip = av.filter.Graph()
    flip.link_nodes(
        flip.add_buffer(width=WIDTH_PX, height=HEIGHT_PX, format="gray", time_base=Fraction(1, 30)),
        flip.add("vflip"),
        flip.add("buffersink"),
    ).configure()
    flip.vpush(filled("gray", luma))
    flipped = flip.vpull()
    assert flipped.planes[0].line_size < 0  # the filter only turns the order of the lines
    assert np.array_equal(luma_plane(flipped), luma[::-1])


def test_ten_bit_video_is_read(tmp_path: Path) -> None:
    lumas = pictures(6, top=1023)
    path = make_clip(tmp_path / "clip.mp4", lumas, "libx265", pix_fmt="yuv420p10le")
    frames = frames_of(path)
    for frame, luma in zip(frames, lumas, strict=True):
        assert frame.luma is not None
        assert np.abs(frame.luma - np.minimum(luma / 4, 255)).max() <= 0.5
