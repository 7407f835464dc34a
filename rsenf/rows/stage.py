"""The rows stage: frames in, blocks of row means of the steady pixels out.

:class:`AutoRows` detects the read-out axis: it samples rows and columns until the flicker shows
which it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages import Frame, Header, RowBlock
from rsenf.messages.schema import Float32Array
from rsenf.rows.settings import AXES, RowsSettings
from rsenf.rows.stabilise import Stabiliser
from rsenf.rows.steady import SteadyMask, picture_part, tile_pixels, tile_sums
from rsenf.timebase import NS_PER_S, nanoseconds

# Below this share of steady pixels, or above this share of clipped rows, row means depend more on
# motion or the sensor's limits than on the light.
MIN_STEADY_RATIO = 0.15
MAX_CLIPPED_RATIO = 0.5
BLACK_LEVEL, WHITE_LEVEL = 17.0, 250.0  # limited-range black is 16


class Rows:
    """Row means of the steady pixels (paper, Section III-B), block by block.

    Implements :class:`rsenf.stage.Stage`: takes :class:`~rsenf.messages.Frame`, returns
    :class:`~rsenf.messages.RowBlock`. Where part of a row moves, its luma is replaced by the
    background, scaled by the brightness of the row's steady part over that part's background. So
    leaving pixels out doesn't shift the row's level. Bars around the first picture are cut off
    (:func:`~rsenf.rows.steady.picture_part`): they are no rows of the sensor. Of a picture that
    moves as a whole, rows are as if it didn't (:mod:`rsenf.rows.stabilise`).

    Parameters
    ----------
    settings : RowsSettings, optional
    """

    def __init__(self, settings: RowsSettings | None = None) -> None:
        self.settings = settings or RowsSettings()
        self._headers: list[Header] = []  # of the frames of the present block
        self._sums: list[NDArray[Any]] = []  # their tile sums
        self._effort = ""  # at which they were decoded
        self._size_px = 0, 0  # height and width of frames; the next five depend on it
        self._part: tuple[slice, slice]
        self._cut: _Cut
        self._steady: SteadyMask
        self._stabiliser: Stabiliser
        self._at_rest: Float32Array | None  # tile sums of the picture as it began to move

    def update(self, message: Frame) -> list[Any]:
        """Take a frame; return the block that it completes, if any."""
        out = []
        size, block = self.settings.block_frames, message.header.frame_first
        if self._headers and self._headers[0].frame_first // size != block // size:
            out.append(self._finish())
        self._take(message)
        if (block + 1) % size == 0:
            out.append(self._finish())
        return out

    def flush(self) -> list[Any]:
        """Return the last, incomplete block."""
        return [self._finish()] if self._headers else []

    def _take(self, frame: Frame) -> None:
        if frame.luma is None:
            raise ValueError("a frame without its luma plane")
        if frame.luma.shape != self._size_px:
            self._resize(frame.luma)
        # The plane itself isn't kept: it may be a view of a buffer that will be reused.
        self._sums.append(self._sums_of(frame.luma[self._part]))
        self._headers.append(frame.header)
        self._effort = self._effort or frame.effort

    def _sums_of(self, luma: NDArray[np.uint8]) -> NDArray[Any]:
        """Tile sums of a picture; once it moves, those of the first one under the present light."""
        axis, light = self.settings.read_out_axis, None
        if self.settings.stabilise:
            light = self._stabiliser.update(luma.T if axis == "columns" else luma)
        if light is not None and self._at_rest is not None:
            return np.asarray(self._at_rest * light)
        sums = tile_sums(luma, axis, self._cut.tiles)
        self._at_rest = None if light is None else np.asarray(sums / light, np.float32)
        return sums

    def _resize(self, luma: NDArray[np.uint8]) -> None:
        height_px, width_px = luma.shape
        if self._headers:
            raise UsageError(
                f"the frame after {self._headers[-1].frame_first} is {width_px}×{height_px}, "
                f"those before it {self._size_px[1]}×{self._size_px[0]}"
            )
        self._size_px = height_px, width_px
        self._part = picture_part(luma)
        self._cut = _Cut(luma[self._part].shape, self.settings)
        self._steady = SteadyMask(self._cut.tiles, self._cut.rows)
        self._stabiliser = Stabiliser(self._cut.rows, self._cut.across_px, self._cut.tiles)
        self._at_rest = None

    def _finish(self) -> RowBlock:
        s, headers, cut = self.settings, self._headers, self._cut
        sums = np.array(self._sums, np.float32)
        tile_means = self._tile_means(sums)
        level, kept = self._level(sums)
        steady_ratio = float(np.add.reduce(kept, axis=None)) / cut.all_px
        clipped = np.count_nonzero((level <= BLACK_LEVEL) | (level >= WHITE_LEVEL)) / level.size
        reason = _why_unusable(steady_ratio, clipped)
        block = RowBlock(
            header=dataclasses.replace(
                headers[0],
                seq=headers[0].frame_first // s.block_frames,
                frame_last=headers[-1].frame_last,
            ),
            read_out_axis=s.read_out_axis,
            frames=len(headers),
            rows=cut.rows,
            strips=cut.strips,
            frame_number=np.array([h.frame_first for h in headers], np.int64),
            frame_pts_ns=np.array([h.pts_ns for h in headers], np.int64),
            level=level,
            kept_px=kept,
            steady_ratio=steady_ratio,
            clipped_ratio=clipped,
            usable=not reason,
            reason=reason,
            effort=self._effort,
            **tile_means,
        )
        self._headers, self._sums, self._effort = [], [], ""
        return block

    def _level(self, sums: Float32Array) -> tuple[Float32Array, NDArray[np.uint32]]:
        """Return row means per strip, (frames, rows, strips), and the pixel counts behind them.

        Replaces moving parts in ``sums`` by the background.
        """
        cut, mask, kept_px = self._cut, self._steady, self._cut.kept_px
        if self.settings.mask:
            steady = mask.update(sums / cut.tile_px)
            if not steady.all():
                _paint_over(sums, mask.background * cut.tile_px, mask, steady)
                of_bands = _by_strip(steady * cut.tile_px, cut.strips)
                kept_px = mask.rows_of(of_bands).astype(np.uint32).T.copy()
            offset = mask.levelling.of_block(len(sums))
            if offset is not None:
                sums += offset * cut.tile_px
        level = np.empty((len(sums), *kept_px.shape), np.float32)
        by_strip = _by_strip(sums, cut.strips)
        np.divide(by_strip, cut.strip_px, out=level.transpose(0, 2, 1))
        return level, kept_px

    def _tile_means(self, sums: Float32Array) -> dict[str, Any]:
        if not self.settings.tile_means:
            return {}
        level = self._steady.band_means(sums / self._cut.tile_px)
        return {
            "bands": self._steady.bands,
            "tiles": sums.shape[1],
            "tile_level": level.transpose(0, 2, 1).copy(),
        }


class _Cut:
    """How planes of one size are cut into tiles and strips, and a row's pixels in each.

    Parameters
    ----------
    size_px : tuple of int
        Height and width.
    settings : RowsSettings
    """

    def __init__(self, size_px: tuple[int, int], settings: RowsSettings) -> None:
        tiles, strips = settings.tiles, settings.strips
        self.across_px = size_px[0] if settings.read_out_axis == "columns" else size_px[1]
        if self.across_px < tiles:  # too narrow for the tiles: a single one
            tiles = strips = 1
        self.strips = strips
        self.tiles = tiles if settings.mask or settings.tile_means else strips
        self.rows, in_row = tile_pixels(*size_px, settings.read_out_axis, self.tiles)
        self.tile_px = in_row.astype(np.float32)[:, None]
        self.strip_px = _by_strip(self.tile_px, strips)
        self.kept_px = np.tile(self.strip_px.T.astype(np.uint32), (self.rows, 1))
        self.all_px = float(self.kept_px.sum())
        self.kept_px.flags.writeable = False  # shared by all blocks without motion


def _by_strip(per_tile: Float32Array, strips: int) -> Float32Array:
    """Add up the tiles of each strip: (…, tiles, n) to (…, strips, n)."""
    *more, _, n = per_tile.shape
    return np.asarray(np.add.reduce(per_tile.reshape(*more, strips, -1, n), axis=-2))


def _over_tiles(per_tile: Float32Array) -> Float32Array:
    """Add up all tiles pairwise, as ``sum`` does with eight of them: (tiles, n) to (n,)."""
    while (tiles := len(per_tile)) > 1:
        pairs = per_tile[0 : tiles - 1 : 2] + per_tile[1::2]
        per_tile = np.concatenate([pairs, per_tile[tiles - 1 :]]) if tiles % 2 else pairs
    return np.asarray(per_tile[0])


def _paint_over(
    sums: Float32Array, background: Float32Array, mask: SteadyMask, steady: NDArray[np.bool_]
) -> None:
    """Replace moving parts in place by their background, scaled by the row's steady part."""
    moved = np.flatnonzero(~steady.all(axis=0))
    touched = slice(mask.band_starts[moved[0]], mask.band_starts[moved[-1] + 1])
    seen, background = sums[..., touched], background[:, touched]
    keep = mask.rows_of(steady.astype(np.float32))[:, touched]
    kept = seen * keep
    bright, usual = np.add.reduce(kept, axis=1), _over_tiles(background * keep)
    gain = np.divide(bright, usual, out=np.ones_like(bright), where=usual > 0)
    np.add(kept, background * (1.0 - keep) * gain[:, None], out=seen)


def _why_unusable(steady_ratio: float, clipped_ratio: float) -> str:
    if steady_ratio < MIN_STEADY_RATIO:
        return f"only {steady_ratio:.0%} of the picture is steady"
    if clipped_ratio > MAX_CLIPPED_RATIO:
        return f"{clipped_ratio:.0%} of the rows are black or white"
    return ""


# Takes the blocks by rows and by columns; returns 'rows', 'columns', or '' if undecided.
Choose = Callable[[Sequence[RowBlock], Sequence[RowBlock]], str]

# Times of the decision. Ten seconds are enough for flicker that survives a good codec; faint
# flicker gets twice that, after which 'rows' is assumed, as in nearly every video.
LOOK_AFTER_S = (10.0, 20.0)
# Limit of frames held, whatever their time stamps: 10 s at 240 frames/s.
MAX_FRAMES = 2400


class AutoRows:
    """Row means along a read-out axis that is detected from the data.

    Implements :class:`rsenf.stage.Stage`, from frames to row blocks. Nothing is sent until the axis
    is decided; then everything, exactly as :class:`~rsenf.rows.stage.Rows` would have sent it.

    Parameters
    ----------
    settings : RowsSettings
        For both samplers; its axis is ignored.
    choose : callable
        Decides on the axis from the blocks of both samplers, see ``Choose``.
    """

    def __init__(self, settings: RowsSettings, choose: Choose) -> None:
        self._choose = choose
        self._samplers: dict[str, Rows] = {
            axis: Rows(dataclasses.replace(settings, read_out_axis=axis)) for axis in AXES
        }
        self._held: dict[str, list[RowBlock]] = {axis: [] for axis in AXES}
        self._chosen: Rows | None = None
        self._frames = self._looks = 0
        self._first_ns = 0

    def update(self, message: Frame) -> list[Any]:
        """Take a frame; return the blocks that it completes, once the axis is decided."""
        if self._chosen:
            return self._chosen.update(message)
        self._first_ns = self._first_ns if self._frames else message.header.pts_ns
        self._frames += 1
        for axis, sampler in self._samplers.items():
            self._held[axis] += sampler.update(message)
        elapsed_ns = message.header.pts_ns - self._first_ns
        full = self._frames >= MAX_FRAMES
        if not full and elapsed_ns < nanoseconds(LOOK_AFTER_S[self._looks]):
            return []
        self._looks += 1
        return self._decide(final=full or self._looks == len(LOOK_AFTER_S))

    def flush(self) -> list[Any]:
        """Return the last block, or all blocks of a stream too short for an earlier decision."""
        if self._chosen:
            return self._chosen.flush()
        for axis, sampler in self._samplers.items():
            self._held[axis] += sampler.flush()
        return self._decide(final=True)

    def _decide(self, *, final: bool) -> list[Any]:
        axis = self._choose(self._held["rows"], self._held["columns"])
        if not axis and not final:
            return []
        axis = axis or "rows"
        blocks = self._held[axis]
        self._chosen = self._samplers[axis]
        self._samplers, self._held = {}, {}
        return blocks


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
