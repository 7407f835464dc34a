"""What is filmed: compressed packets, decoded frames with exact times, and their row luminance.

Row blocks hold the paper's row-luminance series, not concatenated: frames, rows and strips remain
apart, as no row is read in the idle period between frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as plain_field

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.header import Header
from rsenf.messages.schema import Float32Array, FloatArray, Int64Array, UInt32Array, field, message


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
    effort: str = field(12, "'fast' when decoded without the loop filter; else empty", "")
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


@message(13, version=1)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RowBlock:
    """Mean luma of the steady pixels of each row and strip, for the frames of one block.

    Blocks are cut at fixed frame numbers, so that they don't depend on how frames were batched. The
    steady-pixel mask is constant within a block.
    """

    header: Header = field(1, "", None)
    read_out_axis: str = field(
        2, "'rows', 'columns' or 'frame' (one mean for the whole frame)", "rows"
    )
    frames: int = field(3, "frames in this block", 0)
    rows: int = field(4, "rows along the read-out axis", 0)
    strips: int = field(5, "strips across the read-out axis, left to right", 0)
    frame_number: Int64Array = field(
        6,
        "number of each frame; a jump is a frame that never came",
        wire="sfixed64",
        shape=("frames",),
    )
    frame_pts_ns: Int64Array = field(
        7, "exact presentation time of each frame", wire="sfixed64", shape=("frames",)
    )
    level: Float32Array = field(
        8, "mean luma, 8-bit levels", wire="float", shape=("frames", "rows", "strips")
    )
    kept_px: UInt32Array = field(
        9, "steady pixels in each mean", wire="fixed32", shape=("rows", "strips")
    )
    steady_ratio: float = field(10, "share of the pixels that the mask kept, 0 to 1", 1.0)
    clipped_ratio: float = field(11, "share of the rows' means at black or white, 0 to 1", 0.0)
    usable: bool = field(12, "whether enough steady, unclipped pixels are left", True)
    reason: str = field(13, "why not usable; empty when usable", "")
    bands: int = field(14, "bands of rows of the optional tile means", 0)
    tiles: int = field(15, "tiles across each band", 0)
    tile_level: Float32Array = field(
        16,
        "mean luma of each tile; empty unless asked for",
        wire="float",
        shape=("frames", "bands", "tiles"),
    )
    effort: str = field(17, "'fast' when any was decoded without the loop filter; else empty", "")

    def profiles(self) -> FloatArray:
        """Return the mean luma over the strips, shape (frames, rows).

        Computed as a matrix product: NumPy's sums are slow along so short an axis.
        """
        strips = self.level.shape[2]
        return np.asarray(self.level.astype(np.float64) @ np.ones(strips) / strips)
