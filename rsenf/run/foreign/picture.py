"""A picture of another program, as it came."""

from __future__ import annotations

from typing import NamedTuple

# What a still picture begins with. Names of formats are free text in ROS: the bytes are not.
_STILLS = ((b"\xff\xd8\xff", "mjpeg"), (b"\x89PNG\r\n\x1a\n", "png"))


class Coded(NamedTuple):
    """A compressed picture.

    ``stamp_ns`` is the time that the message itself gives, 0 for none; ``codec`` is FFmpeg's name.
    """

    stamp_ns: int
    codec: str
    data: bytes


class Raw(NamedTuple):
    """A picture of bare pixels, lines of ``step_bytes`` (0: without padding) one after another.

    ``encoding`` is ROS's name of a pixel's form; ``big_endian`` is of samples of two bytes.
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
    """Codec of a still picture by its first bytes; empty for an unknown one."""
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "webp"
    return next((codec for begin, codec in _STILLS if data.startswith(begin)), "")
