"""The luma plane of a decoded picture, without colour conversion where the format has one."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import av
import numpy as np
from av.video.plane import VideoPlane
from numpy.typing import NDArray

_BYTE = np.dtype(np.uint8)


@dataclass(frozen=True)
class _Layout:
    """Where a pixel format keeps its luma."""

    convert_to: str  # format to convert to first; empty if plane 0 is luma alone
    dtype: np.dtype[Any]
    shift: int  # bits of a sample beyond 8


@functools.cache
def _layout(pixel_format: str) -> _Layout:
    fmt = av.VideoFormat(pixel_format)
    if fmt.is_rgb or fmt.has_palette or fmt.is_bit_stream or fmt.is_bayer:
        return _Layout("gray", _BYTE, 0)  # no luma: a weighted sum of the colours
    bits = fmt.components[0].bits
    if bits > 16 or not (fmt.is_planar or len(fmt.components) == 1):
        return _Layout("yuv422p", _BYTE, 0)  # luma interleaved with chroma: separate them
    if bits == 8:
        return _Layout("", _BYTE, 0)
    # Samples of 9 to 16 bits use the low bits of two bytes; P010 and related formats the high ones.
    high = pixel_format.startswith(("p0", "p2", "p4"))
    dtype = np.dtype(">u2" if fmt.is_big_endian else "<u2")
    return _Layout("", dtype, 8 if high else bits - 8)


def luma_plane(frame: av.VideoFrame) -> NDArray[np.uint8]:
    """Return the luma of a picture, rows × columns, uint8, read-only.

    For 8-bit formats it is a view that keeps the decoder's buffer alive. Deeper samples are scaled
    to 8-bit levels and rounded. The range (16 to 235, or 0 to 255) stays as coded; only for formats
    without luma (RGB, palettes) full-range luma is computed.
    """
    layout = _layout(frame.format.name)
    if layout.convert_to:
        frame = frame.reformat(format=layout.convert_to)
    plane: Any = VideoPlane(frame, 0)  # frame.planes makes all of them
    line_bytes = plane.line_size  # padded at many widths
    size_px, strides = (frame.height, frame.width), (abs(line_bytes), layout.dtype.itemsize)
    samples: NDArray[Any] = np.ndarray(size_px, layout.dtype, plane, strides=strides)
    if line_bytes < 0:
        samples = samples[::-1]  # stored bottom-up
    luma = _to_8_bit(samples, layout.shift) if layout.shift else samples
    luma.flags.writeable = False  # this memory is the decoder's reference for later pictures
    return luma


def _to_8_bit(samples: NDArray[np.uint16], shift: int) -> NDArray[np.uint8]:
    import cv2

    native = samples.astype(np.uint16, copy=False)
    scaled: NDArray[np.uint8] = cv2.convertScaleAbs(native, alpha=2.0**-shift)
    return scaled
