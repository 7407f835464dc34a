"""Row blocks from luminance that another program has sampled."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import Header, RowBlock
from rsenf.timebase import NS_PER_S


def blocks_from_luminance(
    level: NDArray[np.floating],
    frame_time_s: NDArray[np.floating],
    header: Header,
    *,
    block_frames: int = 8,
    read_out_axis: str = "rows",
) -> Iterator[RowBlock]:
    """Cut an array of luminance into row blocks like those of the rows stage.

    Parameters
    ----------
    level : ndarray, shape (frames, rows, strips)
        Mean luma, in levels.
    frame_time_s : ndarray, shape (frames,)
        Start of each frame, seconds, increasing.
    header : Header
        Template of the headers: source, run id, and where frame times come from.
    block_frames : int
        Frames per block.
    read_out_axis : str
        'rows' or 'columns'; 'frame' for a single mean per frame.
    """
    pts_ns = np.round(np.asarray(frame_time_s, np.float64) * NS_PER_S).astype(np.int64)
    frames, rows, strips = level.shape
    for seq, first in enumerate(range(0, frames, block_frames)):
        part = slice(first, min(first + block_frames, frames))
        yield RowBlock(
            header=dataclasses.replace(
                header,
                seq=seq,
                frame_first=part.start,
                frame_last=part.stop - 1,
                pts_ns=int(pts_ns[first]),
            ),
            read_out_axis=read_out_axis,
            frames=part.stop - part.start,
            rows=rows,
            strips=strips,
            frame_number=np.arange(part.start, part.stop, dtype=np.int64),
            frame_pts_ns=pts_ns[part],
            level=np.ascontiguousarray(level[part], np.float32),
            kept_px=np.ones((rows, strips), np.uint32),
        )
