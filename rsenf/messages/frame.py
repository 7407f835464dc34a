"""A decoded frame (a luma plane with its exact time), and a compressed video packet."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as plain_field

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.header import Header
from rsenf.messages.schema import field, message


@message(4, version=1)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Frame:
    """One frame. Its luma plane is in this process, in a shared-memory ring, or in the message.

    ``luma`` (height_px × width_px, uint8) is filled in by the receiver and is read-only: it may be
    a view of the decoder's or the ring's memory. ``pixels`` is the same plane without padding, used
    only over TCP.
    """

    header: Header = field(1, "", None)
    height_px: int = field(2, "rows of the coded picture, before any rotation for display", 0)
    width_px: int = field(3, "columns of the coded picture", 0)
    rotation_deg: int = field(4, "rotation for display, clockwise; the rows here are unrotated", 0)
    declared_rate_hz: float = field(
        5, "frame rate the container claims; never used as a clock", 0.0
    )
    codec: str = field(6, "h264, hevc, vp9, mjpeg, rawvideo, …", "")
    keyframe: bool = field(7, "coded without reference to other frames", False)
    ring: str = field(8, "name of the shared-memory ring; empty when not there", "")
    ring_slot: int = field(9, "slot of the ring", 0)
    ring_ticket: int = field(10, "what the slot's counter reads while this frame is in it", 0)
    pixels: bytes = field(11, "the luma plane, row by row; empty when not sent", b"")
    luma: NDArray[np.uint8] | None = plain_field(default=None, compare=False)


@message(5, version=1)
@dataclass(frozen=True, kw_only=True, slots=True)
class VideoPacket:
    """One compressed picture from the source, for recording without re-encoding."""

    header: Header = field(1, "", None)
    codec: str = field(2, "h264, hevc, vp8, vp9, av1, mjpeg, png, webp", "")
    keyframe: bool = field(3, "can be decoded without earlier packets", False)
    data: bytes = field(4, "Annex B for h264 and hevc, parameter sets with every key frame", b"")
    untimed: bool = field(
        5,
        "pts_ns is its time of decoding: the n-th picture shown has that of the n-th packet",
        False,
    )
