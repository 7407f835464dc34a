"""Row means of the steady pixels the obvious way: every operation on all frames, rows and tiles."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array
from rsenf.rows import steady
from rsenf.rows.tiles import tile_edges


class SlowRows:
    """Blocks of planes in, their row means and the pixels behind them out; eight tiles.

    Parameters
    ----------
    axis : str
    strips : int
    """

    def __init__(self, axis: str, strips: int) -> None:
        self._axis, self._strips = axis, strips
        self._background: Float32Array | None = None
        self._spread: Float32Array | None = None

    def update(self, planes: list[NDArray[np.uint8]]) -> tuple[Float32Array, NDArray[np.uint32]]:
        """Return means, (frames, rows, strips), and steady pixels, (rows, strips)."""
        upright = [p if self._axis == "rows" else p.T for p in planes]
        edges = tile_edges(upright[0].shape[1], 8)
        tiles = list(itertools.pairwise(edges))
        sums = np.stack(
            [np.stack([p[:, a:b].sum(axis=1) for a, b in tiles], axis=1) for p in upright]
        ).astype(np.float32)
        pixels = np.diff(np.array(edges)).astype(np.float32)
        keep = self._steady(sums / pixels)
        assert self._background is not None
        if not keep.all():
            sums = _paint_over(sums, keep, self._background * pixels)
        per_strip = (sums.shape[1], self._strips, 8 // self._strips)
        level = sums.reshape(-1, *per_strip).sum(axis=3)
        kept = (keep * pixels).reshape(per_strip).sum(axis=2)
        return level / pixels.reshape(self._strips, -1).sum(axis=1), kept.astype(np.uint32)

    def _steady(self, level: Float32Array) -> NDArray[np.bool_]:
        rows = level.shape[1]
        bands = max(1, rows // steady.BAND_ROWS)
        starts = np.arange(bands) * rows // bands
        sizes = np.diff(np.append(starts, rows))
        of_row = np.repeat(np.arange(bands), sizes)

        def band_means(of: Float32Array) -> Float32Array:
            return np.add.reduceat(of, starts, axis=-2) / sizes[:, None].astype(np.float32)

        first = self._background is None
        if self._background is None or self._spread is None:
            self._background = np.median(level, axis=0)
            least = steady.MIN_DEVIATION_LEVEL / steady.SPREADS
            self._spread = np.full((bands, 8), least, np.float32)
        floor = np.maximum(band_means(self._background), 1.0)
        cells = band_means(level)
        gain = np.maximum(np.median(cells / floor, axis=2), 1e-3)
        deviation = cells - gain[:, :, None] * floor
        usual = np.maximum(steady.MIN_DEVIATION_LEVEL, steady.SPREADS * self._spread)
        quiet = np.max(np.abs(deviation), axis=0) <= usual
        quiet &= self._spread <= steady.RESTLESS_LEVEL
        weight = 1.0 if first else np.where(quiet, steady.LEARNING_RATE, 0.0)
        spread = np.sqrt(np.mean(deviation**2, axis=0))
        self._spread = (self._spread + weight * (spread - self._spread)).astype(np.float32)
        slow = steady.LEARNING_RATE / steady.MOVING_SLOWDOWN
        rate = np.where(quiet, steady.LEARNING_RATE, slow)[of_row]
        flat = (level / gain[:, of_row, None]).mean(axis=0)
        self._background = (self._background + rate * (flat - self._background)).astype(np.float32)
        return np.asarray(quiet[of_row])


def _paint_over(
    sums: Float32Array, keep: NDArray[np.bool_], background: Float32Array
) -> Float32Array:
    bright = (sums * keep).sum(axis=2, keepdims=True)
    usual = (background * keep).sum(axis=1)[:, None]
    gain = np.divide(bright, usual, out=np.ones_like(bright), where=usual > 0)
    return np.where(keep, sums, background * gain)
