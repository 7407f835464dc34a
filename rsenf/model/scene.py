"""What the camera looks at: a still, textured wall, and perhaps something that moves over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.moving import MovingBox
from rsenf.model.parameters import parameter
from rsenf.model.seeds import generator

Float32Array = NDArray[np.float32]
Region = tuple[slice, slice]

_DARKEST, _BRIGHTEST = 4.0, 240.0  # room for noise and flicker before the eight bits end


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A wall of about mid grey."""

    mean_level: float = parameter(110.0, "mean 8-bit level under the mean light", low=10, high=220)
    texture_ratio: float = parameter(
        0.08, "standard deviation of the texture over the mean", low=0, high=0.5
    )
    vignetting_ratio: float = parameter(0.2, "light lost in the corners", low=0, high=0.9)
    moving: MovingBox | None = None


class View:
    """The scene as levels under the mean light, for one size of frame.

    Attributes
    ----------
    wall : ndarray of float32 (rows, columns)
    box : ndarray of float32 (box rows, box columns) or None
    """

    def __init__(self, scene: Scene, rows: int, columns: int, seed: int) -> None:
        down = np.linspace(-1, 1, rows, dtype=np.float32)[:, None]
        across = np.linspace(-1, 1, columns, dtype=np.float32)
        fall_off = 1 - scene.vignetting_ratio * (down**2 + across**2) / 2
        wall = (1 + scene.texture_ratio * _texture(rows, columns, seed, "wall")) * fall_off
        self.wall = _levels(wall, scene.mean_level)
        self.moving = scene.moving
        self.box: Float32Array | None = None
        if scene.moving is not None:
            height, width = scene.moving.size_px(rows, columns)
            box = 1 + scene.moving.texture_ratio * _texture(height, width, seed, "box")
            self.box = _levels(box, scene.mean_level * scene.moving.level_ratio)

    def box_region(self, t_s: float) -> Region | None:
        """Rows and columns that the box covers in a frame that begins at a time."""
        if self.moving is None or self.box is None:
            return None
        rows, columns = self.wall.shape
        top, left = self.moving.top_px(rows), self.moving.left_px(t_s, columns)
        return slice(top, top + self.box.shape[0]), slice(left, left + self.box.shape[1])

    def strip_means(self, t_s: NDArray[np.float64], strips: int) -> Float32Array:
        """Mean level of each row's strips, in frames that begin at the times.

        Returns
        -------
        ndarray of float32 (frames, rows, strips), or (1, rows, strips) when nothing moves
        """
        edges = strip_edges(self.wall.shape[1], strips)
        sums = np.add.reduceat(self.wall, edges[:-1], axis=1, dtype=np.float64)
        if self.box is None:
            return (sums / np.diff(edges)).astype(np.float32)[None]
        out = np.repeat(sums[None], len(t_s), axis=0)
        before = _running(self.wall)
        box_before = _running(self.box)
        for n, t in enumerate(t_s.tolist()):
            down, across = self.box_region(t) or (slice(0), slice(0))
            cut = np.clip(edges, across.start, across.stop)
            out[n, down] += np.diff(box_before[:, cut - across.start] - before[down][:, cut])
        return (out / np.diff(edges)).astype(np.float32)


def strip_edges(columns: int, strips: int) -> NDArray[np.int64]:
    """Columns where strips begin, and the end of the last: (strips + 1,)."""
    return np.round(np.linspace(0, columns, strips + 1)).astype(np.int64)


def _running(levels: Float32Array) -> NDArray[np.float64]:
    """Sum of each row up to, not including, a column."""
    return np.cumsum(np.pad(levels, ((0, 0), (1, 0))), axis=1, dtype=np.float64)


def _levels(relative: NDArray[np.floating], mean_level: float) -> Float32Array:
    scaled = relative * (mean_level / relative.mean())
    return np.asarray(np.clip(scaled, _DARKEST, _BRIGHTEST), np.float32)


def _texture(rows: int, columns: int, seed: int, name: str) -> Float32Array:
    """Octaves of smooth noise, coarse ones strongest; mean 0, standard deviation 1."""
    import cv2

    rng = generator(seed, f"texture of the {name}")
    total = np.zeros((rows, columns), np.float32)
    for octave in range(6):
        cells = 4 << octave
        coarse = rng.standard_normal((cells, cells), dtype=np.float32)
        total += 0.7**octave * cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)
    return np.asarray((total - total.mean()) / total.std(), dtype=np.float32)
