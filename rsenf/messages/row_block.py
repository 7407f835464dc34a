"""Row luminance of a block of frames: the paper's row-luminance series, not concatenated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.messages.header import Header
from rsenf.messages.schema import Float32Array, FloatArray, Int64Array, UInt32Array, field, message


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

    def profiles(self) -> FloatArray:
        """Return the mean luma over the strips, shape (frames, rows).

        Computed as a matrix product: NumPy's sums are slow along so short an axis.
        """
        strips = self.level.shape[2]
        return np.asarray(self.level.astype(np.float64) @ np.ones(strips) / strips)
