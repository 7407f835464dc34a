"""Frames in, blocks of row means out."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages import Frame, Header, RowBlock
from rsenf.messages.schema import Float32Array
from rsenf.rows.settings import RowsSettings
from rsenf.rows.steady import SteadyMask
from rsenf.rows.tiles import tile_pixels, tile_sums

# Below this share of steady pixels, or above this share of clipped rows, the row means say more
# about motion or the sensor's limits than about the light.
MIN_STEADY_RATIO = 0.15
MAX_CLIPPED_RATIO = 0.5
BLACK_LEVEL, WHITE_LEVEL = 17.0, 250.0  # limited-range black is 16


class Rows:
    """Row means of the steady pixels, as in the paper's Section III-A, block by block.

    Implements :class:`rsenf.stage.Stage`: takes :class:`~rsenf.messages.Frame`, yields
    :class:`~rsenf.messages.RowBlock`. Where a part of a row moves, its luma is replaced by the
    background there times the brightness ratio of the row's steady part, so that leaving pixels
    out doesn't shift the row's level.

    Parameters
    ----------
    settings : RowsSettings, optional
    """

    def __init__(self, settings: RowsSettings | None = None) -> None:
        self.settings = settings or RowsSettings()
        self._headers: list[Header] = []  # of the block's frames, with their sums
        self._size_px = 0, 0  # of its frames, height and width
        self._sums: list[Float32Array] = []
        self._steady: SteadyMask | None = None

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
        s = self.settings
        height_px, width_px = self._size_px
        if self._headers and frame.luma.shape != self._size_px:
            raise UsageError(
                f"frame {frame.header.frame_first} is {frame.luma.shape[1]}×{frame.luma.shape[0]}, "
                f"those before it {width_px}×{height_px}"
            )
        tiles = s.tiles if s.mask or s.tile_means else s.strips
        self._sums.append(tile_sums(frame.luma, s.read_out_axis, tiles))
        # The picture itself isn't kept: it may be a view of a buffer that will be used again.
        self._headers.append(frame.header)
        self._size_px = frame.height_px, frame.width_px

    def _finish(self) -> RowBlock:
        s, headers = self.settings, self._headers
        sums = np.stack(self._sums)
        rows, in_row = tile_pixels(*self._size_px, s.read_out_axis, sums.shape[2])
        # Written out to every row: numpy is slow where a short axis is the one that repeats.
        pixels = np.tile(in_row.astype(np.float32), (rows, 1))
        level, kept = self._level(sums, pixels)
        steady_ratio = float(kept.sum()) / float(rows * in_row.sum())
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
            rows=rows,
            strips=s.strips,
            frame_number=np.array([h.frame_first for h in headers], np.int64),
            frame_pts_ns=np.array([h.pts_ns for h in headers], np.int64),
            level=level,
            kept_px=kept,
            steady_ratio=steady_ratio,
            clipped_ratio=clipped,
            usable=not reason,
            reason=reason,
            **self._tile_means(sums, pixels),
        )
        self._headers, self._sums = [], []
        return block

    def _level(
        self, sums: Float32Array, pixels: Float32Array
    ) -> tuple[Float32Array, NDArray[np.uint32]]:
        """Row means per strip, (frames, rows, strips), and the pixels behind them."""
        strips = self.settings.strips
        keep = np.ones(pixels.shape, bool)
        if self.settings.mask:
            if self._steady is None or self._steady.shape != pixels.shape:
                self._steady = SteadyMask(*pixels.shape)
            keep = self._steady.update(sums / pixels)
            if not keep.all():
                sums = _paint_over(sums, keep, self._steady.background * pixels)
        level = _by_strip(sums, strips) / _by_strip(pixels, strips)
        return level, _by_strip(keep * pixels, strips).astype(np.uint32)

    def _tile_means(self, sums: Float32Array, pixels: Float32Array) -> dict[str, Any]:
        if not self.settings.tile_means:
            return {}
        bands = self._steady or SteadyMask(*pixels.shape)
        level = bands.band_means(sums / pixels)
        return {"bands": bands.bands, "tiles": pixels.shape[1], "tile_level": level}


def _by_strip(per_tile: Float32Array, strips: int) -> Float32Array:
    """Add up the tiles of each strip: (…, tiles) to (…, strips).

    Tile by tile of all rows, which is many times faster than row by row.
    """
    of_strip = per_tile.reshape(*per_tile.shape[:-1], strips, -1)
    return functools.reduce(np.add, (of_strip[..., k] for k in range(of_strip.shape[-1])))


def _over_tiles(per_tile: Float32Array) -> Float32Array:
    """Add up all tiles, pair by pair, as ``sum`` does with eight of them: (…, tiles) to (…, 1)."""
    while (tiles := per_tile.shape[-1]) > 1:
        pairs = per_tile[..., 0 : tiles - 1 : 2] + per_tile[..., 1::2]
        odd = per_tile[..., tiles - tiles % 2 :]
        per_tile = np.concatenate([pairs, odd], axis=-1) if odd.size else pairs
    return per_tile


def _paint_over(
    sums: Float32Array, keep: NDArray[np.bool_], background: Float32Array
) -> Float32Array:
    """Replace what moves by its background, as bright as the steady part of the same row."""
    rows = np.flatnonzero(~keep.all(axis=1))
    touched = slice(rows[0], rows[-1] + 1)
    seen, steady, background = sums[:, touched], keep[touched], background[touched]
    bright, usual = _over_tiles(seen * steady), _over_tiles(background * steady)
    gain = np.divide(bright, usual, out=np.ones_like(bright), where=usual > 0)
    out = sums.copy()
    np.copyto(out[:, touched], background * gain, where=~steady)
    return out


def _why_unusable(steady_ratio: float, clipped_ratio: float) -> str:
    if steady_ratio < MIN_STEADY_RATIO:
        return f"only {steady_ratio:.0%} of the picture is steady"
    if clipped_ratio > MAX_CLIPPED_RATIO:
        return f"{clipped_ratio:.0%} of the rows are black or white"
    return ""
