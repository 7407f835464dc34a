"""A picture of another program as it was stored: compressed or raw."""

from __future__ import annotations

from typing import NamedTuple

# Magic numbers of still pictures. Format names are free text in ROS, so they aren't relied on.
_STILLS = ((b"\xff\xd8\xff", "mjpeg"), (b"\x89PNG\r\n\x1a\n", "png"))


class Coded(NamedTuple):
    """A compressed picture.

    ``stamp_ns`` is the time stamp in the message, 0 for none; ``codec`` is FFmpeg's name of it.
    """

    stamp_ns: int
    codec: str
    data: bytes


class Raw(NamedTuple):
    """An uncompressed picture, in lines of ``step_bytes`` (0: no padding).

    ``encoding`` is ROS's name of the pixel format; ``big_endian`` applies to 16-bit samples.
    """

    stamp_ns: int
    encoding: str
    width_px: int
    height_px: int
    step_bytes: int
    big_endian: bool
    data: bytes


Picture = Coded | Raw


def still_codec(data: bytes) -> str:
    """Return the codec of a still picture by its first bytes; empty if unknown.

    >>> still_codec(b"\\xff\\xd8\\xff\\xe0")
    'mjpeg'
    """
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "webp"
    return next((codec for begin, codec in _STILLS if data.startswith(begin)), "")
