"""Frames in, blocks of row means out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.messages import Frame, RowBlock
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
        self._frames: list[Frame] = []
        self._sums: list[Float32Array] = []
        self._steady: SteadyMask | None = None

    def update(self, message: Frame) -> list[Any]:
        """Take a frame; return the block that it completes, if any."""
        out = []
        size, block = self.settings.block_frames, message.header.frame_first
        if self._frames and self._frames[0].header.frame_first // size != block // size:
            out.append(self._finish())
        self._take(message)
        if (block + 1) % size == 0:
            out.append(self._finish())
        return out

    def flush(self) -> list[Any]:
        """Return the last, incomplete block."""
        return [self._finish()] if self._frames else []

    def _take(self, frame: Frame) -> None:
        if frame.luma is None:
            raise ValueError("a frame without its luma plane")
        s = self.settings
        if self._frames and frame.luma.shape != _shape(self._frames[0]):
            raise UsageError(
                f"frame {frame.header.frame_first} is {frame.luma.shape[1]}×{frame.luma.shape[0]}, "
                f"those before it {self._frames[0].width_px}×{self._frames[0].height_px}"
            )
        tiles = s.tiles if s.mask or s.tile_means else s.strips
        self._sums.append(tile_sums(frame.luma, s.read_out_axis, tiles))
        # The picture itself isn't kept: it may be a view of a buffer that will be used again.
        self._frames.append(dataclasses.replace(frame, luma=None))

    def _finish(self) -> RowBlock:
        s, first, last = self.settings, self._frames[0], self._frames[-1]
        sums = np.stack(self._sums)
        rows, pixels = tile_pixels(first.height_px, first.width_px, s.read_out_axis, sums.shape[2])
        level, kept = self._level(sums, pixels.astype(np.float32))
        steady_ratio = float(kept.sum()) / float(rows * pixels.sum())
        clipped = float(np.mean((level <= BLACK_LEVEL) | (level >= WHITE_LEVEL)))
        reason = _why_unusable(steady_ratio, clipped)
        block = RowBlock(
            header=dataclasses.replace(
                first.header,
                seq=first.header.frame_first // s.block_frames,
                frame_last=last.header.frame_last,
            ),
            read_out_axis=s.read_out_axis,
            frames=len(self._frames),
            rows=rows,
            strips=s.strips,
            frame_number=np.array([f.header.frame_first for f in self._frames], np.int64),
            frame_pts_ns=np.array([f.header.pts_ns for f in self._frames], np.int64),
            level=level,
            kept_px=kept,
            steady_ratio=steady_ratio,
            clipped_ratio=clipped,
            usable=not reason,
            reason=reason,
            **self._tile_means(sums, pixels),
        )
        self._frames, self._sums = [], []
        return block

    def _level(
        self, sums: Float32Array, pixels: Float32Array
    ) -> tuple[Float32Array, NDArray[np.uint32]]:
        """Row means per strip, (frames, rows, strips), and the pixels behind them."""
        strips = self.settings.strips
        rows, tiles = sums.shape[1:]
        keep = np.ones((rows, tiles), bool)
        if self.settings.mask:
            if self._steady is None or self._steady.shape != keep.shape:
                self._steady = SteadyMask(rows, tiles)
            keep = self._steady.update(sums / pixels)
            if not keep.all():
                sums = _paint_over(sums, keep, self._steady.background * pixels)
        per_strip = (rows, strips, tiles // strips)
        level = sums.reshape(-1, *per_strip).sum(axis=3) / pixels.reshape(strips, -1).sum(axis=1)
        kept = (keep * pixels).reshape(per_strip).sum(axis=2)
        return np.asarray(level, np.float32), kept.astype(np.uint32)

    def _tile_means(self, sums: Float32Array, pixels: NDArray[np.int64]) -> dict[str, Any]:
        if not self.settings.tile_means:
            return {}
        rows, tiles = sums.shape[1:]
        bands = self._steady or SteadyMask(rows, tiles)
        level = bands.band_means(np.asarray(sums / pixels, np.float32))
        return {"bands": bands.bands, "tiles": tiles, "tile_level": level}


def _shape(frame: Frame) -> tuple[int, int]:
    return frame.height_px, frame.width_px


def _paint_over(
    sums: Float32Array, keep: NDArray[np.bool_], background: Float32Array
) -> Float32Array:
    """Replace what moves by its background, as bright as the steady part of the same row."""
    steady = (sums * keep).sum(axis=2, keepdims=True)
    usual = (background * keep).sum(axis=1)[:, None]
    gain = np.divide(steady, usual, out=np.ones_like(steady), where=usual > 0)
    return np.where(keep, sums, background * gain)


def _why_unusable(steady_ratio: float, clipped_ratio: float) -> str:
    if steady_ratio < MIN_STEADY_RATIO:
        return f"only {steady_ratio:.0%} of the picture is steady"
    if clipped_ratio > MAX_CLIPPED_RATIO:
        return f"{clipped_ratio:.0%} of the rows are black or white"
    return ""
