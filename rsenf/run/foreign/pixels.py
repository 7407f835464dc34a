"""From bare pixels to luma."""

from __future__ import annotations

from typing import NamedTuple

import av
import numpy as np
from numpy.typing import NDArray

from rsenf.decode.coded import LARGEST_PX
from rsenf.decode.luma import luma_plane
from rsenf.errors import SchemaMismatch
from rsenf.run.foreign.picture import Raw


class _Form(NamedTuple):
    """A pixel's bytes, and how to get at its luma: a byte of it, or FFmpeg's name of the form."""

    bytes: int
    luma_byte: int = 0
    ffmpeg: str = ""


# https://docs.ros.org/en/rolling/p/sensor_msgs/ (image_encodings.hpp) and foxglove.RawImage. Planes
# of colour follow those of luma, and aren't looked at.
_FORMS = {
    **dict.fromkeys(("mono8", "8UC1", "nv12", "nv21", "nv24"), _Form(1)),
    **dict.fromkeys(("yuv422", "uyvy"), _Form(2, luma_byte=1)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), _Form(2)),
    "rgb8": _Form(3, ffmpeg="rgb24"),
    "rgba8": _Form(4, ffmpeg="rgba"),
    **dict.fromkeys(("bgr8", "8UC3"), _Form(3, ffmpeg="bgr24")),
    **dict.fromkeys(("bgra8", "8UC4"), _Form(4, ffmpeg="bgra")),
    **dict.fromkeys(("mono16", "16UC1"), _Form(2, ffmpeg="gray16")),
    **{f"bayer_{p}8": _Form(1, ffmpeg=f"bayer_{p}8") for p in ("rggb", "bggr", "gbrg", "grbg")},
}


def raw_luma(raw: Raw) -> NDArray[np.uint8]:
    """Return the luma of a raw picture, rows × columns, uint8, read-only.

    What has luma keeps it as it is; of colours it is made as for every other input.

    Raises
    ------
    SchemaMismatch
        When the form isn't known, or the data don't fill the picture.
    """
    form = _FORMS.get(raw.encoding)
    if form is None:
        raise SchemaMismatch(f"pixels in a form that isn't known: {raw.encoding[:40]!r}")
    lines = _lines(raw, form.bytes)
    if form.ffmpeg:
        return _by_ffmpeg(raw, form.ffmpeg, lines)
    return lines[:, form.luma_byte :: form.bytes]


def _lines(raw: Raw, pixel_bytes: int) -> NDArray[np.uint8]:
    """Lines of the picture, without their padding."""
    size = f"{raw.width_px}×{raw.height_px}"
    if not 0 < raw.width_px * raw.height_px <= LARGEST_PX:
        raise SchemaMismatch(f"a picture of {size} pixels")
    line_bytes = raw.width_px * pixel_bytes
    step = raw.step_bytes or line_bytes
    if step < line_bytes or len(raw.data) < step * (raw.height_px - 1) + line_bytes:
        raise SchemaMismatch(
            f"{len(raw.data)} bytes in lines of {step} don't fill {size} pixels of {pixel_bytes}"
        )
    whole = np.frombuffer(raw.data, np.uint8)
    return np.lib.stride_tricks.as_strided(
        whole, (raw.height_px, line_bytes), (step, 1), writeable=False
    )


def _by_ffmpeg(raw: Raw, name: str, lines: NDArray[np.uint8]) -> NDArray[np.uint8]:
    if name == "gray16":
        name += "be" if raw.big_endian else "le"
    height_px, width_px = raw.height_px, raw.width_px
    if name.startswith("bayer"):
        # FFmpeg aborts the process at odd heights: whole cells, the colours of a mosaic kept.
        lines = np.pad(lines, ((0, height_px % 2), (0, width_px % 2)), mode="reflect")
        height_px, width_px = lines.shape
    try:
        frame = av.VideoFrame(width_px, height_px, name)
    except (av.FFmpegError, ValueError, MemoryError) as exc:
        raise SchemaMismatch(f"no {name} picture is {width_px}×{height_px}") from exc
    plane = frame.planes[0]
    padded = np.zeros((plane.buffer_size // plane.line_size, plane.line_size), np.uint8)
    padded[: lines.shape[0], : lines.shape[1]] = lines
    plane.update(padded.tobytes())
    return luma_plane(frame)[: raw.height_px, : raw.width_px]
