"""Row means of the steady pixels the obvious way: every operation on all frames, rows and tiles."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array
from rsenf.rows import steady
from rsenf.rows.steady import tile_edges


class SlowRows:
    """Blocks of planes in, their row means and the pixels behind them out; eight tiles.

    Parameters
    ----------
    axis : str
    strips : int
    """

    def __init__(self, axis: str, strips: int) -> None:
        self._axis, self._strips = axis, strips
        self._background = self._spread = np.empty(0, np.float32)
        self._cells = self._gain = np.empty(0, np.float32)  # of two frames before
        self._steady_before = np.empty(0, bool)
        self._offset: Float32Array | None = None

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
        if not keep.all():
            sums = _paint_over(sums, keep, self._background * pixels)
        if self._offset is not None:
            passed = np.arange(1, len(sums) + 1, dtype=np.float32)
            fade = np.exp(-passed / (len(sums) * steady.FADES_BLOCKS))
            sums = sums + fade[:, None, None] * self._offset * pixels
            is_over = np.abs(self._offset).max() <= steady.NOTHING_LEVEL
            self._offset = None if is_over else fade[-1] * self._offset
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

        first = not self._background.size
        cells = band_means(level)
        if first:
            self._background = np.median(level, axis=0)
            least = steady.MIN_DEVIATION_LEVEL / steady.SPREADS
            self._spread = np.full((bands, 8), least, np.float32)
            self._cells, self._gain = cells[:0], np.empty((0, bands), np.float32)
            self._steady_before = np.ones((bands, 8), bool)
        floor = np.maximum(band_means(self._background), 1.0)
        gain = self._common_factor(cells, floor, first=first)
        seen, light = np.concatenate([self._cells, cells]), np.concatenate([self._gain, gain])
        evenly = seen * (gain.mean(axis=0) / light)[:, :, None]
        place = np.arange(len(evenly), dtype=np.float32) / max(len(evenly) - 1, 1)
        place = (place - place.mean())[:, None, None]
        rise = (place * evenly).sum(axis=0) / (place**2).sum()
        quick = evenly - evenly.mean(axis=0) - place * rise
        usual = np.maximum(steady.MIN_DEVIATION_LEVEL, steady.SPREADS * self._spread)
        quiet = np.max(np.abs(quick), axis=0) <= usual
        quiet &= (self._spread <= steady.RESTLESS_LEVEL) & (np.abs(rise) <= steady.SLOW_LEVEL)
        spread = np.sqrt(np.mean(quick**2, axis=0))
        weight = np.where(quiet | (spread < self._spread), steady.LEARNING_RATE, 0.0)
        weight = np.ones((bands, 8)) if first else weight
        self._spread = (self._spread + weight * (spread - self._spread)).astype(np.float32)
        back = quiet & ~self._steady_before
        rate = np.where(back, 1.0, np.where(quiet, steady.FOLLOW_RATE, 0.0)).astype(np.float32)
        flat = (level / gain[:, of_row, None]).mean(axis=0)
        before = self._background
        self._background = before + rate[of_row] * (flat - before)
        if back.any():
            shown = (back * gain.mean(axis=0)[:, None])[of_row]
            offset = 0.0 if self._offset is None else self._offset
            self._offset = offset + before * shown - self._background * shown
        self._cells, self._gain = cells[-2:], gain[-2:]
        self._steady_before = quiet
        return np.asarray(quiet[of_row])

    def _common_factor(
        self, cells: Float32Array, floor: Float32Array, *, first: bool
    ) -> Float32Array:
        """Median of a band's cells; where any moves, one that goes by who was steady and near."""
        ratio = cells / floor
        gain = np.asarray(np.median(ratio, axis=2), np.float32)
        off = np.abs(cells - gain[:, :, None] * floor)
        still = self._steady_before.all() and off.max() <= steady.MIN_DEVIATION_LEVEL
        if first or still:
            return gain
        usual = self._gain.mean(axis=0)
        for frame, band in np.ndindex(gain.shape):
            trust = np.where(self._steady_before[band], 1.0, steady.DOUBTED)
            beyond = (ratio[frame, band] / usual[band] - np.float32(1.0)) / steady.NEAR
            trust = trust / (1.0 + beyond**2)
            order = np.argsort(ratio[frame, band])
            reached = np.cumsum(trust[order])
            at = order[int(np.argmax(reached >= reached[-1] / 2.0))]
            gain[frame, band] = ratio[frame, band, at]
        lost = ~self._steady_before.any(axis=1)
        return np.where(lost, gain * (usual / gain.mean(axis=0)), gain)


def _paint_over(
    sums: Float32Array, keep: NDArray[np.bool_], background: Float32Array
) -> Float32Array:
    bright = (sums * keep).sum(axis=2, keepdims=True)
    usual = (background * keep).sum(axis=1)[:, None]
    gain = np.divide(bright, usual, out=np.ones_like(bright), where=usual > 0)
    return np.where(keep, sums, background * gain)
