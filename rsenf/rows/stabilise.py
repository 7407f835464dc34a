"""Samples the rows of a picture that moves as a whole, as one from a hand does.

Model: a picture is a scene times the light on its rows. The scene shifts from frame to frame, the
light's pattern stays on the rows of the sensor. The scene is the running mean of all frames, each
moved back by its shift (a mosaic, larger than a picture), in which the flicker averages out. So a
row's brightness over the mosaic's, where it shows the same part of the scene, is the light.

Shifts are found by phase correlation with the mosaic, without each row's mean: there the light acts
most. Approximate: shifts alone, no rotation or zoom; flicker that hardly turns from frame to frame
fades in the mosaic within its memory.

References
----------
- Kuglin, C. D. and Hines, D. C. (1975), The phase correlation image alignment method, Proc. IEEE
  Int. Conf. Cybernetics and Society, 163.
- Irani, M. and Anandan, P. (1998), Video indexing based on mosaic representations, Proc. IEEE 86,
  905.
"""

from __future__ import annotations

import functools
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array

ACROSS_PX, ROWS_PX = 160, 240  # size of reduced pictures, and of those that shifts are found in
MARGIN = 0.25  # of a picture, by which the mosaic is larger on each side
MEMORY_FRAMES = 5000.0  # of the mosaic's mean
# A picture moves if both its halves have shifted by more than this (reduced pixels), and alike to
# this, between so many of the last checks; least height of the correlation's peak. Frames from
# check to check: of a picture that moves, and most of one that rests.
MOVED_PX, MOVED_CHECKS, CHECKS, MIN_RESPONSE = 0.5, 2, 4, 0.2
CHECK_FRAMES, MOST_CHECK_FRAMES = 8, 64
# A picture rests again once it has stayed within so many pixels for so many frames.
REST_PX, REST_FRAMES = 2.0, 1800
# Height of the correlation's peak, over its usual one, below which another scene is shown; and the
# weight of exponential smoothing of the usual one.
OTHER_SCENE, LEARNING_RATE = 0.3, 0.1
MIN_SEEN = 0.5  # share of a tile's row that the mosaic has to know


class Stabiliser:
    """Follows the shifts of one size of pictures, from when they begin to move.

    Parameters
    ----------
    rows, across_px : int
        Size of the pictures along the read-out axis, and across it.
    tiles : int
        Number of tiles across that axis.
    """

    def __init__(self, rows: int, across_px: int, tiles: int) -> None:
        self._tiles, self._rows = tiles, rows
        self._across_px = tiles * max(min(ACROSS_PX, across_px) // tiles, 1)
        self._step = max(rows // ROWS_PX, 1)  # of rows, for checks
        self._wait, self._waited = CHECK_FRAMES, 0  # frames from check to check, and since the last
        self._moved = [False] * CHECKS
        self._last: list[Float32Array] = []  # halves of the picture at the last check
        self._mosaic: _Mosaic | None = None
        self._usual = 0.0  # height of the correlation's peak

    def update(self, luma: NDArray[np.uint8]) -> Float32Array | None:
        """Return the light on a picture's rows over its mean, (tiles, rows); None while it rests.

        Parameters
        ----------
        luma : ndarray of uint8, shape (rows, across_px)
        """
        if self._mosaic is None and not self._moves(luma):
            return None
        size = self._across_px, self._rows
        picture = cv2.resize(luma, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if self._mosaic is None:
            self._mosaic = _Mosaic(picture)
        known = np.asarray(self._mosaic.around() > 0.0, np.float32)
        shift, response = _shift(picture, self._mosaic.around(mean=True), known)
        if response > OTHER_SCENE * self._usual:  # not so for NaN, of a blank picture
            self._mosaic.move(shift)
            self._usual += LEARNING_RATE * (response - self._usual)
        else:
            self._mosaic, self._usual = _Mosaic(picture), 0.0
        if self._mosaic.rested_frames > REST_FRAMES:
            self._mosaic, self._last, self._moved = None, [], [False] * CHECKS
            return None
        scene, seen = self._mosaic.shown()
        self._mosaic.add(picture)
        return self._ratio(picture, scene, seen)

    def _moves(self, luma: NDArray[np.uint8]) -> bool:
        """Whether the picture has begun to move: both halves alike, so it isn't what is in it."""
        self._waited += 1
        if self._last and self._waited < self._wait:
            return False
        rows = luma[:: self._step]
        size = self._across_px, len(rows)
        picture = cv2.resize(rows, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        halves, last = np.array_split(picture, 2, axis=1), self._last
        self._last, self._waited = halves, 0
        if last:
            found = [
                _shift(now, was, np.ones_like(now)) for now, was in zip(halves, last, strict=True)
            ]
            (first, second), responses = zip(*found, strict=True)
            moved_px = min(np.hypot(*first), np.hypot(*second))
            alike = np.hypot(*np.subtract(first, second)) < MOVED_PX < moved_px
            self._moved = [*self._moved[1:], bool(alike and min(responses) > MIN_RESPONSE)]
            rests = not self._moved[-1]
            self._wait = min(2 * self._wait, MOST_CHECK_FRAMES) if rests else CHECK_FRAMES
        return sum(self._moved) >= MOVED_CHECKS

    def _ratio(
        self, picture: Float32Array, scene: Float32Array, seen: Float32Array
    ) -> Float32Array:
        """Return the brightness of each tile's rows over the scene's, (tiles, rows)."""
        cut = (self._rows, self._tiles, -1)
        shown, usual = ((of * seen).reshape(cut).sum(axis=2) for of in (picture, scene))
        enough = seen.reshape(cut).mean(axis=2) >= MIN_SEEN
        enough &= usual > 0.0
        ratio = np.where(enough, shown / np.where(enough, usual, 1.0), 0.0)
        row = ratio.sum(axis=1, keepdims=True) / np.maximum(enough.sum(axis=1, keepdims=True), 1)
        row[row == 0.0] = 1.0
        return np.asarray(np.where(enough, ratio, row).T, np.float32)


def _shift(
    picture: Float32Array, scene: Float32Array, known: Float32Array
) -> tuple[tuple[float, float], float]:
    """Return how far a picture lies from a scene, across and down, and the peak's height.

    ``known`` is 1 where the scene is known, else 0; all of one shape.
    """
    rows, across = picture.shape
    size = across, min(rows, ROWS_PX)
    count = np.maximum(known.sum(axis=1, keepdims=True), 1.0)
    parts: list[Any] = []
    for of in (picture, scene):
        shown = of * known
        shown -= known * (shown.sum(axis=1, keepdims=True) / count)
        parts.append(cv2.resize(shown, size, interpolation=cv2.INTER_AREA))
    (right, down), response = cv2.phaseCorrelate(parts[0], parts[1], _window(size))
    return (right, down * rows / size[1]), response


@functools.cache
def _window(size: tuple[int, int]) -> Any:
    return cv2.createHanningWindow(size, cv2.CV_32F)


class _Mosaic:
    """Mean of pictures, each moved to its place; and where the last one lay."""

    def __init__(self, picture: Float32Array) -> None:
        rows, across = picture.shape
        self._size = across, rows
        self._edge = np.array([int(MARGIN * across), int(MARGIN * rows)])
        self._place = np.zeros(2)  # across and down
        self._rest = np.zeros(2)  # where it has stayed, and for how long
        self.rested_frames = 0
        self._mean = np.zeros((rows + 2 * self._edge[1], across + 2 * self._edge[0]), np.float32)
        self._count = np.zeros_like(self._mean)
        self.add(picture)

    def _around(self) -> tuple[slice, slice]:
        """Part of the mosaic nearest to the last picture."""
        left, top = np.rint(self._place).astype(int) + self._edge
        return slice(top, top + self._size[1]), slice(left, left + self._size[0])

    def around(self, *, mean: bool = False) -> Float32Array:
        """Return the number of frames, or their mean, nearest to the last picture."""
        return (self._mean if mean else self._count)[self._around()]

    def move(self, shift: tuple[float, float]) -> None:
        """Move on by a shift, across and down; at its edge, the mosaic is centred anew."""
        self._place = np.rint(self._place) + shift
        if np.any(np.abs(self._place) > self._edge - 1):
            over = np.rint(self._place)
            self._place -= over
            self._rest -= over
            at = np.array([[1.0, 0.0, -over[0]], [0.0, 1.0, -over[1]]])
            self._mean, self._count = (
                cv2.warpAffine(of, at, of.shape[::-1], flags=cv2.INTER_NEAREST)
                for of in (self._mean, self._count)
            )

        self.rested_frames += 1
        if np.hypot(*(self._place - self._rest)) > REST_PX:
            self._rest, self.rested_frames = self._place.copy(), 0

    def shown(self) -> tuple[Float32Array, Float32Array]:
        """Return what the picture's place has shown in the mean, and where that is known."""
        left, top = self._place + self._edge
        at = np.array([[1.0, 0.0, left], [0.0, 1.0, top]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        mean, known = (
            cv2.warpAffine(of, at, self._size, flags=flags)
            for of in (self._mean, (self._count > 0.0).astype(np.float32))
        )
        return np.asarray(mean), np.asarray(known > 1.0 - 1e-3, np.float32)

    def add(self, picture: Float32Array) -> None:
        """Add a picture at its place."""
        across, down = self._place - np.rint(self._place)
        at = np.array([[1.0, 0.0, across], [0.0, 1.0, down]])
        moved = cv2.warpAffine(picture, at, self._size, borderMode=cv2.BORDER_REPLICATE)
        part = self._around()
        self._count[part] = np.minimum(self._count[part] + 1.0, MEMORY_FRAMES)
        self._mean[part] += (moved - self._mean[part]) / self._count[part]
