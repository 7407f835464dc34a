"""Samples the rows of a picture that moves as a whole, as one from a hand does.

Model: a picture is a scene times the light on its rows. The scene moves from frame to frame, the
light's pattern stays on the rows of the sensor. The scene is the mean of the first frames that show
each part of it, moved back (a mosaic, larger than a picture), in which the flicker averages out. So
a row's brightness over the mosaic's, where it shows the same part of the scene, is the light.

The motion is an affine map, by phase correlation of a picture's quarters with the mosaic, both over
their rows' means: so the light cancels. Approximate: no parallax, no bend by the read-out; light
that hardly turns from frame to frame leaves its pattern in the mosaic.

References
----------
- Kuglin, C. D. and Hines, D. C. (1975), The phase correlation image alignment method, Proc. IEEE
  Int. Conf. Cybernetics and Society, 163.
- Irani, M. and Anandan, P. (1998), Video indexing based on mosaic representations, Proc. IEEE 86,
  905.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rsenf.messages.schema import Float32Array

ACROSS_PX, ROWS_PX = 160, 240  # size of reduced pictures, and of those that shifts are found in
MARGIN = 0.25  # of a picture, by which the mosaic is larger on each side
# Pictures that each point of the mosaic is the mean of. It stays as it is then: light that hardly
# turns would change it all the time, and be bent by it.
LEARNT_FRAMES = 64
# A picture moves if it has shifted by more (reduced pixels) between so many of the last checks;
# least height of the correlation's peak, and of that times the root of the pixels: two pictures of
# noise have 17 in 1 pair of 100, 19 to 24 in 1 of 1000.
MOVED_PX, MOVED_CHECKS, CHECKS, MIN_RESPONSE, NOISE_RESPONSE = 0.5, 2, 4, 0.2, 20.0
# Blocks each way, of which each votes for the shift, or for none, if that leaves so much less.
# Fewest votes, and least share for the shift: with less, something in the picture moves. Least
# change of a picture's contrast: less is noise, and its steps of brightness.
BLOCKS, CLEARLY, MIN_VOTES, MIN_SHARE, LEAST_CHANGE = 8, 1.3, 6, 0.8, 0.02
# Frames from check to check: of a picture that moves, and most of one that rests.
CHECK_FRAMES, MOST_CHECK_FRAMES = 8, 64
# A picture rests again once it has stayed within so many pixels for so many frames.
REST_PX, REST_FRAMES = 2.0, 1800
# Height of the correlation's peak, over its usual one, below which another scene is shown; and the
# weight of exponential smoothing of the usual one.
OTHER_SCENE, LEARNING_RATE = 0.3, 0.1
MOST_TWIST_PX = 2.0  # by which shifts of quarters of a picture may differ from those of a plane
SMALLEST_PX = 4  # quarters of a picture need two pixels
LEAST_LEVEL = 8.0  # of a row's mean: darker rows are mostly noise
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
        self._last: Float32Array | None = None  # picture at the last check
        self._mosaic: _Mosaic | None = None
        self._usual = 0.0  # height of the correlation's peak

    def update(self, luma: NDArray[np.uint8]) -> Float32Array | None:
        """Return the light on a picture's rows over its mean; None at rest (Kuglin and Hines 1975).

        Parameters
        ----------
        luma : ndarray of uint8, shape (rows, across_px)
        """
        is_tiny = min(luma.shape) < SMALLEST_PX
        if is_tiny or (self._mosaic is None and not self._moves(luma)):
            return None
        size = self._across_px, self._rows
        picture = cv2.resize(luma, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        if self._mosaic is None:
            self._mosaic = _Mosaic(picture)
        motion, response = _motion(picture, *self._mosaic.shown())
        if response > OTHER_SCENE * self._usual:  # not so for NaN, of a blank picture
            self._mosaic.move(motion)
            self._usual += LEARNING_RATE * (response - self._usual)
        else:
            self._mosaic, self._usual = _Mosaic(picture), 0.0
        if self._mosaic.rested_frames > REST_FRAMES:
            self._mosaic, self._last, self._moved = None, None, [False] * CHECKS
            return None
        scene, seen = self._mosaic.shown()
        self._mosaic.add(picture)
        return self._ratio(picture, scene, seen)

    def _moves(self, luma: NDArray[np.uint8]) -> bool:
        """Whether the picture has begun to move."""
        self._waited += 1
        if self._last is not None and self._waited < self._wait:
            return False
        rows = luma[:: self._step]
        size = self._across_px, len(rows)
        picture = cv2.resize(rows, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        last, self._last, self._waited = self._last, picture, 0
        if last is not None:
            self._moved = [*self._moved[1:], _has_moved(picture, last)]
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


def _has_moved(picture: Float32Array, last: Float32Array) -> bool:
    """Whether a picture is the last one shifted, in nearly all its parts."""
    known = np.ones_like(picture)
    (across, down), response = _shift(picture, last, known)
    if not (response > MIN_RESPONSE and np.hypot(across, down) > MOVED_PX):
        return False
    at = np.array([[1.0, 0.0, across], [0.0, 1.0, down]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    back = cv2.warpAffine(last, at, last.shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
    now, *others = (_contrast(of, known) for of in (picture, last, back))
    by_rest, by_shift = (
        cv2.resize(np.abs(now - of), (BLOCKS, BLOCKS), interpolation=cv2.INTER_AREA)
        for of in others
    )
    for_shift = (by_rest > CLEARLY * by_shift) & (by_rest > LEAST_CHANGE)
    moved, rested = np.sum(for_shift), np.sum(by_shift > CLEARLY * by_rest)
    return bool(moved > MIN_VOTES and moved > MIN_SHARE * (moved + rested))


def _motion(
    picture: Float32Array, scene: Float32Array, known: Float32Array
) -> tuple[NDArray[np.float64], float]:
    """Return where a picture's points are in a scene, an affine map (2, 3), and the peaks' height.

    By the shifts of its quarters; by their median alone where they aren't those of one plane.
    """
    cuts = [np.array_split(np.arange(size), 2) for size in picture.shape]
    middles, shifts, responses = [], [], []
    for rows, across in itertools.product(*cuts):
        part = np.ix_(rows, across)
        shift, response = _shift(picture[part], scene[part], known[part])
        middles.append((across.mean(), rows.mean(), 1.0))
        shifts.append(shift)
        responses.append(response)
    moved, points = np.array(shifts), np.array(middles)
    twist = moved[0] + moved[3] - moved[1] - moved[2]
    if np.hypot(*twist) > MOST_TWIST_PX or not min(responses) > MIN_RESPONSE:
        moved = np.tile(np.median(moved, axis=0), (4, 1))
    mapped = np.linalg.lstsq(points, points[:, :2] + moved)[0]
    return np.asarray(mapped.T), float(np.mean(responses))


def _shift(
    picture: Float32Array, scene: Float32Array, known: Float32Array
) -> tuple[tuple[float, float], float]:
    """Return how far a picture lies from a scene, across and down, and the peak's height.

    ``known`` is 1 where the scene is known, else 0; all of one shape. A peak that noise would make
    has height 0.
    """
    rows, across = picture.shape
    size = across, min(rows, ROWS_PX)
    parts: list[Any] = [
        cv2.resize(_contrast(of, known), size, interpolation=cv2.INTER_AREA)
        for of in (picture, scene)
    ]
    (right, down), response = cv2.phaseCorrelate(parts[0], parts[1], _window(size))
    noise = NOISE_RESPONSE / np.sqrt(size[0] * size[1])
    return (right, down * rows / size[1]), response if response > noise else 0.0


def _contrast(picture: Float32Array, known: Float32Array) -> Float32Array:
    """Return a picture over the mean of each row, less 1: light that a row shares cancels."""
    count = np.maximum(known.sum(axis=1, keepdims=True), 1.0)
    row = (picture * known).sum(axis=1, keepdims=True) / count
    return np.asarray(known * (picture - row) / np.maximum(row, LEAST_LEVEL))


@functools.cache
def _window(size: tuple[int, int]) -> Any:
    return cv2.createHanningWindow(size, cv2.CV_32F)


class _Mosaic:
    """Mean of pictures, each moved to its place; and where the last one was."""

    def __init__(self, picture: Float32Array) -> None:
        rows, across = picture.shape
        self._size, self._middle = (across, rows), np.array([across / 2, rows / 2, 1.0])
        edge = np.array([int(MARGIN * across), int(MARGIN * rows)])
        self._at = np.column_stack([np.eye(2), edge])  # from a picture's points to the mosaic's
        self._edge, self._rest = edge, self._at @ self._middle
        self.rested_frames = 0  # in which the middle stayed there
        self._mean = np.zeros((rows + 2 * edge[1], across + 2 * edge[0]), np.float32)
        self._count = np.zeros_like(self._mean)
        self.add(picture)

    def move(self, motion: NDArray[np.float64]) -> None:
        """Move on by an affine map (2, 3); at its edge, the mosaic is centred anew."""
        self._at = self._at @ np.vstack([motion, (0.0, 0.0, 1.0)])
        off = self._at @ self._middle - self._middle[:2] - self._edge
        if np.any(np.abs(off) > self._edge):
            over = np.rint(off)
            self._at[:, 2] -= over
            self._rest = self._rest - over
            back = np.column_stack([np.eye(2), -over])
            self._mean, self._count = (
                cv2.warpAffine(of, back, of.shape[::-1], flags=cv2.INTER_NEAREST)
                for of in (self._mean, self._count)
            )
        self.rested_frames += 1
        if np.hypot(*(self._at @ self._middle - self._rest)) > REST_PX:
            self._rest, self.rested_frames = self._at @ self._middle, 0

    def shown(self) -> tuple[Float32Array, Float32Array]:
        """Return what the picture's place has shown in the mean, and where that is known."""
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        mean, known = (
            cv2.warpAffine(of, self._at, self._size, flags=flags)
            for of in (self._mean, (self._count > 0.0).astype(np.float32))
        )
        return np.asarray(mean), np.asarray(known > 1.0 - 1e-3, np.float32)

    def add(self, picture: Float32Array) -> None:
        """Add a picture at its place."""
        moved = cv2.warpAffine(picture, self._at, self._mean.shape[::-1], borderValue=-1e6)
        learns = (moved >= 0.0) & (self._count < LEARNT_FRAMES)
        self._count += learns
        self._mean += np.where(learns, (moved - self._mean) / np.maximum(self._count, 1.0), 0.0)
