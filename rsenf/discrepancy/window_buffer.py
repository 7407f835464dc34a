"""Buffer of a stream's newest rows, averaged into lines; the same however they were batched."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Sequence

import numpy as np

from rsenf.discrepancy.lines import averaged, group_of
from rsenf.messages import Header, RowBlock

BLOCK_FRAMES = 8


class WindowBuffer:
    """Rows of one shape; a block of another shape empties it first.

    Parameters
    ----------
    lines : int
        Largest number of lines of a frame.
    """

    def __init__(self, lines: int) -> None:
        self._lines = lines
        self._blocks: deque[RowBlock] = deque()

    def add(self, block: RowBlock) -> None:
        """Add the newest frames."""
        thin = thinned(block, self._lines)
        if self._blocks and _shape(self._blocks[0]) != _shape(thin):
            self._blocks.clear()
        self._blocks.append(thin)

    def forget_before(self, pts_ns: int) -> None:
        """Drop frames before a time of the stream."""
        while self._blocks and self._blocks[0].frame_pts_ns[0] < pts_ns:
            oldest = self._blocks.popleft()
            kept = int(np.searchsorted(oldest.frame_pts_ns, pts_ns))
            if kept < oldest.frames:
                self._blocks.appendleft(part_of(oldest, kept, oldest.frames))

    @property
    def header(self) -> Header | None:
        """Header that covers all of its frames; None if empty."""
        return joined(self._blocks).header if self._blocks else None

    @property
    def span_ns(self) -> int:
        """Time from the first frame to the last."""
        if not self._blocks:
            return 0
        return int(self._blocks[-1].frame_pts_ns[-1] - self._blocks[0].frame_pts_ns[0])

    def blocks(self) -> list[RowBlock]:
        """Return all rows in blocks of ``BLOCK_FRAMES``, with time stamps from the first frame."""
        if not self._blocks:
            return []
        whole = joined(self._blocks)
        since_start = whole.frame_pts_ns - whole.frame_pts_ns[0]
        whole = dataclasses.replace(whole, frame_pts_ns=since_start)
        firsts = range(0, whole.frames, BLOCK_FRAMES)
        return [part_of(whole, k, min(k + BLOCK_FRAMES, whole.frames)) for k in firsts]


def thinned(block: RowBlock, lines: int) -> RowBlock:
    """Average neighbouring rows of a block into at most ``lines`` lines."""
    group = group_of(block.rows, lines)
    if group == 1:
        return block
    kept = block.rows // group
    pixels = block.kept_px[: kept * group].reshape(kept, group, block.strips)
    return dataclasses.replace(
        block,
        rows=kept,
        level=averaged(block.level, group),
        kept_px=pixels.sum(axis=1, dtype=np.uint32),
    )


def part_of(block: RowBlock, first: int, end: int) -> RowBlock:
    """Return the frames ``first`` to ``end − 1`` of a block, by index."""
    part, pts_ns = slice(first, end), int(block.frame_pts_ns[first])
    since_ns = pts_ns - int(block.frame_pts_ns[0])
    header = block.header
    return dataclasses.replace(
        block,
        header=dataclasses.replace(
            header,
            frame_first=int(block.frame_number[first]),
            frame_last=int(block.frame_number[end - 1]),
            pts_ns=pts_ns,
            camera_time_ns=header.camera_time_ns and header.camera_time_ns + since_ns,
        ),
        frames=end - first,
        frame_number=block.frame_number[part],
        frame_pts_ns=block.frame_pts_ns[part],
        level=block.level[part],
        tile_level=block.tile_level[part],
    )


def joined(blocks: Sequence[RowBlock]) -> RowBlock:
    """Join successive blocks of one shape."""
    first, last = blocks[0], blocks[-1]
    return dataclasses.replace(
        first,
        header=dataclasses.replace(
            last.header,
            frame_first=int(first.frame_number[0]),
            pts_ns=int(first.frame_pts_ns[0]),
            camera_time_ns=first.header.camera_time_ns,
        ),
        frames=sum(block.frames for block in blocks),
        frame_number=np.concatenate([block.frame_number for block in blocks]),
        frame_pts_ns=np.concatenate([block.frame_pts_ns for block in blocks]),
        level=np.concatenate([block.level for block in blocks]),
        tile_level=first.tile_level[:0],
        bands=0,
        tiles=0,
    )


def _shape(block: RowBlock) -> tuple[str, int, int]:
    return block.read_out_axis, block.rows, block.strips
