"""The scene in the order of the read-out: lines of pixels, whole or as means of strips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.scene import Float32Array
from rsenf.model.sensor import WHITE
from rsenf.model.strips import places, strip_edges

Region = tuple[slice, slice]

MARGIN_PX = 64  # edge padding of the wall


@dataclass(frozen=True, eq=False)
class Patch:
    """A picture in front of the wall.

    Parameters
    ----------
    level : ndarray of float32 (rows, columns)
        8-bit levels under the mean light.
    place : callable
        From true time (s) to row and column of the upper left corner. The patch must be within the
        frame.
    """

    level: Float32Array
    place: Callable[[float], tuple[int, int]]


class View:
    """A wall, and optionally a patch in front of it, in the order of the read-out.

    Parameters
    ----------
    wall : ndarray of float32 (rows, columns)
        8-bit levels under the mean light.
    patch : Patch or None
        Object that moves in front of it.
    exponent : float
        Of the camera's tone curve, which is applied to all levels.
    along_columns : bool
        Whether lines are columns; all pictures are then transposed.

    Attributes
    ----------
    wall : ndarray of float32 (lines, pixels)
    patch : ndarray of float32 (patch lines, patch pixels) or None
    """

    def __init__(
        self, wall: Float32Array, patch: Patch | None, exponent: float, along_columns: bool
    ) -> None:
        self._turned = along_columns
        self._place = patch.place if patch else None
        self.wall = self._lines(wall, exponent)
        self.patch = self._lines(patch.level, exponent) if patch else None
        self._edged = np.pad(self.wall, MARGIN_PX, mode="edge")
        self._before = _running(self._edged)
        self._patch_before = None if self.patch is None else _running(self.patch)

    def region(self, t_s: float) -> Region | None:
        """Lines and pixels that the patch covers in a frame that begins at a true time."""
        if self._place is None or self.patch is None:
            return None
        row, column = self._place(t_s)
        top, left = (column, row) if self._turned else (row, column)
        lines, pixels = self.patch.shape
        return slice(top, top + lines), slice(left, left + pixels)

    def shifted(self, shift_px: NDArray[np.float64]) -> Float32Array:
        """Return the wall displaced, with linear interpolation between pixels."""
        import cv2

        (top, down), (left, right) = map(_whole_and_rest, shift_px)
        lines, pixels = self.wall.shape
        near = self._edged[top : top + lines + 1, left : left + pixels]
        far = self._edged[top : top + lines + 1, left + 1 : left + 1 + pixels]
        across = cv2.addWeighted(near, 1 - right, far, right, 0)
        return np.asarray(cv2.addWeighted(across[:-1], 1 - down, across[1:], down, 0))

    def strip_means(
        self, t_s: NDArray[np.float64], shift_px: NDArray[np.float64], strips: int
    ) -> Float32Array:
        """Mean level of each line's strips.

        Parameters
        ----------
        t_s : ndarray (frames,)
            True start of each frame.
        shift_px : ndarray (frames, 2)
            Displacement of the scene.
        strips : int

        Returns
        -------
        ndarray of float32 (frames, lines, strips), or (1, lines, strips) if nothing moves
        """
        edges = strip_edges(self.wall.shape[1], strips)
        if self.patch is None and not shift_px.any():
            t_s = t_s[:1]
        means = np.empty((len(t_s), len(self.wall), strips), np.float32)
        for n, t in enumerate(t_s.tolist()):
            sums = self._wall_sums(shift_px[n], edges)
            region = self.region(t)
            if region is not None and self._patch_before is not None:
                down, across = region
                cut = np.clip(edges, across.start, across.stop)
                sums[down] += np.diff(self._patch_before[:, cut - across.start])
                sums[down] -= self._wall_sums(shift_px[n], cut)[down]
            means[n] = sums / np.diff(edges)
        return means

    def strip_places(self, strips: int) -> Float32Array:
        """Centroid of each strip's light, −½ to ½ along the line: (lines, strips)."""
        pixels = self.wall.shape[1]
        begins = strip_edges(pixels, strips)[:-1]
        moments = np.add.reduceat(self.wall * places(pixels), begins, axis=1)
        return np.asarray(moments / np.add.reduceat(self.wall, begins, axis=1), np.float32)

    def _wall_sums(
        self, shift_px: NDArray[np.float64], edges: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Sums of the displaced wall between edges: (lines, edges − 1)."""
        (top, down), (left, right) = map(_whole_and_rest, shift_px)
        held = self._before[top : top + len(self.wall) + 1]
        across = (1 - right) * held[:, left + edges] + right * held[:, left + 1 + edges]
        return np.diff((1 - down) * across[:-1] + down * across[1:])

    def _lines(self, level: Float32Array, exponent: float) -> Float32Array:
        lines = np.ascontiguousarray(level.T) if self._turned else level
        return lines if exponent == 1 else WHITE * (lines / WHITE) ** np.float32(exponent)


def _running(levels: Float32Array) -> NDArray[np.float64]:
    """Cumulative sum along each line, up to but not including each pixel."""
    return np.cumsum(np.pad(levels, ((0, 0), (1, 0))), axis=1, dtype=np.float64)


def _whole_and_rest(shift_px: float) -> tuple[int, float]:
    """Displacement as the first pixel of the padded wall and a fraction."""
    place = MARGIN_PX - min(max(float(shift_px), 1.0 - MARGIN_PX), MARGIN_PX - 1.0)
    whole = int(place)
    return whole, place - whole
