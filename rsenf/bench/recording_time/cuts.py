"""A film cut into pieces of one length, each a clip of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.bench.recording_time.plan import Film
from rsenf.messages import RowBlock
from rsenf.timebase import NS_PER_S

LENGTHS_S = (600.0, 300.0, 120.0, 60.0)


@dataclass(frozen=True)
class Cuts:
    """All pieces of one length of one coding of a film: one task.

    Parameters
    ----------
    film : Film
    coding : str
    length_s : float
    methods : tuple of str
        Of matching.
    noise_hz : float
        Standard deviation of the noise of the references.
    """

    film: Film
    coding: str
    length_s: float
    methods: tuple[str, ...]
    noise_hz: float

    @property
    def key(self) -> str:
        """Unique name, by which their record is found."""
        tried = f"{','.join(self.methods)} {1e3 * self.noise_hz:g}mHz"
        return f"{self.film.key} {self.coding} {self.length_s:g}s {tried}"


@dataclass(frozen=True, eq=False)
class Piece:
    """One piece: number, start in the film (s), and rows, counted from its first frame."""

    number: int
    begin_s: float
    blocks: list[RowBlock]


def pieces_of(blocks: Sequence[RowBlock], length_s: float) -> Iterator[Piece]:
    """Cut a film's blocks into whole pieces, each from the start of a block, up to 8 frames late.

    Frame numbers, sequence numbers and time stamps start at 0. Rows are those of the whole film:
    the codec and the steady-pixel mask had its earlier frames.

    Parameters
    ----------
    blocks : sequence of RowBlock
    length_s : float
        By the camera's clock; a rest is left out.
    """
    origin_ns = int(blocks[0].frame_pts_ns[0])
    begin_s = np.array([(int(b.frame_pts_ns[0]) - origin_ns) / NS_PER_S for b in blocks])
    last = blocks[-1]
    frame_s = (int(last.frame_pts_ns[-1]) - origin_ns) / NS_PER_S / max(_frames(blocks) - 1, 1)
    end_s = (int(last.frame_pts_ns[-1]) - origin_ns) / NS_PER_S + frame_s
    # The last piece may lack a frame.
    for number in range(int((end_s + frame_s) / length_s)):
        first, stop = np.searchsorted(begin_s, [number * length_s, (number + 1) * length_s])
        part = blocks[first:stop]
        yield Piece(
            number, float(begin_s[first]), [_moved(b, part[0], n) for n, b in enumerate(part)]
        )


def _frames(blocks: Sequence[RowBlock]) -> int:
    return sum(block.frames for block in blocks)


def _moved(block: RowBlock, first: RowBlock, seq: int) -> RowBlock:
    """Return a block with frame numbers and times relative to the first block of its piece."""
    frame, pts_ns = int(first.frame_number[0]), int(first.frame_pts_ns[0])
    header = dataclasses.replace(
        block.header,
        seq=seq,
        frame_first=block.header.frame_first - frame,
        frame_last=block.header.frame_last - frame,
        pts_ns=block.header.pts_ns - pts_ns,
    )
    return dataclasses.replace(
        block,
        header=header,
        frame_number=block.frame_number - frame,
        frame_pts_ns=block.frame_pts_ns - pts_ns,
    )
