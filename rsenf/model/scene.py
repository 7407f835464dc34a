"""The scene: a textured wall, filmed by a camera that may shake, in the order of the read-out.

:class:`View` gives its lines of pixels, whole or as means of strips.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.noise import WHITE, Float32Array, generator, wander
from rsenf.model.parameters import ParameterError, parameter
from rsenf.model.shutter import Shutter

Region = tuple[slice, slice]
MARGIN_PX = 64  # edge padding of the wall
_DARKEST, _BRIGHTEST = 4.0, 240.0  # headroom for noise and flicker within 8 bits


def strip_edges(pixels: int, strips: int) -> NDArray[np.int64]:
    """Pixels where strips begin, and the end of the last: (strips + 1,).

    >>> strip_edges(1280, 4).tolist()
    [0, 320, 640, 960, 1280]
    """
    return np.round(np.linspace(0, pixels, strips + 1)).astype(np.int64)


def places(pixels: int) -> NDArray[np.float32]:
    """Position of each pixel's middle along its line, from −½ to ½."""
    return ((np.arange(pixels) + 0.5) / pixels - 0.5).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Shake:
    """A camera that shakes: the picture moves, the read-out times don't."""

    shake_px: float = parameter(0.5, "rms of the movement, in each direction", low=0, high=20)
    time_constant_s: float = parameter(0.1, "of a tremor; 0.1 s is a hand's", low=0, high=60)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A wall of about mid grey, or one that was measured."""

    mean_level: float = parameter(110.0, "mean 8-bit level under the mean light", low=10, high=220)
    texture_ratio: float = parameter(
        0.08, "standard deviation of the texture over the mean", low=0, high=0.5
    )
    vignetting_ratio: float = parameter(0.2, "light lost in the corners", low=0, high=0.9)
    profile: tuple[tuple[float, ...], ...] | None = parameter(
        None,
        "measured levels under the mean light, before any gamma: a list for each line, with one "
        "for each of its strips; it takes the place of the three above",
    )
    shake: Shake | None = None

    @property
    def level(self) -> float:
        """Mean 8-bit level under the mean light."""
        return self.mean_level if self.profile is None else float(np.mean(self.profile))

    def check(self, shutter: Shutter) -> None:
        """Check the profile against the shutter.

        Raises
        ------
        ParameterError
            For a profile of another number of lines, or with invalid levels.
        """
        if self.profile is None:
            return
        at, strips = ("scene", "profile"), {len(line) for line in self.profile}
        fits = len(self.profile) == shutter.lines and len(strips) == 1
        if not fits or not 1 <= min(strips) <= shutter.across_px:
            raise ParameterError(at, f"isn't {shutter.lines} lines of equally many strips")
        if not all(0 <= level <= WHITE for line in self.profile for level in line):
            raise ParameterError(at, f"has levels that aren't between 0 and {WHITE:g}")

    def wall(self, shutter: Shutter, seed: int) -> Float32Array:
        """Draw the wall under the mean light: 8-bit levels (rows, columns)."""
        if self.profile is not None:
            widths = np.diff(strip_edges(shutter.across_px, len(self.profile[0])))
            lines = np.repeat(np.array(self.profile, np.float32), widths, axis=1)
            return lines.T if shutter.read_out == "columns" else lines
        rows, columns = shutter.rows, shutter.columns
        down = np.linspace(-1, 1, rows, dtype=np.float32)[:, None]
        across = np.linspace(-1, 1, columns, dtype=np.float32)
        fall_off = 1 - self.vignetting_ratio * (down**2 + across**2) / 2
        relative = (1 + self.texture_ratio * texture(rows, columns, seed, "wall")) * fall_off
        return levels(relative, self.mean_level)

    def shift_px(self, frames: int, step_s: float, seed: int) -> NDArray[np.float64]:
        """Draw the displacement of the picture, down and to the right: (frames, 2)."""
        if self.shake is None:
            return np.zeros((frames, 2))
        held = self.shake
        return held.shake_px * np.stack([
            wander(generator(seed, f"camera shake {way}"), frames, step_s, held.time_constant_s)
            for way in ("down", "right")
        ], axis=1)  # fmt: skip


def levels(relative: NDArray[np.floating], mean_level: float) -> Float32Array:
    """Scale a picture to a mean level, and clip it to leave headroom within 8 bits."""
    scaled = relative * (mean_level / relative.mean())
    return np.asarray(np.clip(scaled, _DARKEST, _BRIGHTEST), np.float32)


def texture(rows: int, columns: int, seed: int, name: str) -> Float32Array:
    """Sum of octaves of smooth noise, coarse ones strongest; mean 0, standard deviation 1.

    Parameters
    ----------
    rows, columns : int
    seed : int
    name : str
        Of the object, which gets its own random numbers.
    """
    import cv2

    rng = generator(seed, f"texture of the {name}")
    total = np.zeros((rows, columns), np.float32)
    for octave in range(6):
        cells = 4 << octave
        coarse = rng.standard_normal((cells, cells), dtype=np.float32)
        total += 0.7**octave * cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)
    return np.asarray((total - total.mean()) / total.std(), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Patch:
    """A picture in front of the wall."""

    level: Float32Array  # (rows, columns) 8-bit levels under the mean light
    # from true time (s) to row and column of the upper left corner. The patch must be within the
    # frame
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

    def shifted(self, shift_px: NDArray[np.float64], across_px: float) -> Float32Array:
        """Return the wall displaced; pixels are interpolated, cubically in the lines' order.

        Parameters
        ----------
        shift_px : ndarray (lines,) or (1,)
            Displacement in the lines' order.
        across_px : float
            And along the lines.
        """
        import cv2

        left, right = _whole_and_rest(across_px)
        lines, pixels = self.wall.shape
        near = self._edged[:, left : left + pixels]
        far = self._edged[:, left + 1 : left + 1 + pixels]
        return _displaced(cv2.addWeighted(near, 1 - right, far, right, 0), shift_px, lines)

    def strip_means(
        self,
        t_s: NDArray[np.float64],
        shift_px: NDArray[np.float64],
        across_px: NDArray[np.float64],
        strips: int,
    ) -> Float32Array:
        """Mean level of each line's strips.

        Parameters
        ----------
        t_s : ndarray (frames,)
            True start of each frame.
        shift_px : ndarray (frames, lines) or (frames, 1)
            Displacement of the scene in the lines' order.
        across_px : ndarray (frames,)
            And along the lines.
        strips : int

        Returns
        -------
        ndarray of float32 (frames, lines, strips), or (1, lines, strips) if nothing moves
        """
        edges = strip_edges(self.wall.shape[1], strips)
        if self.patch is None and not shift_px.any() and not across_px.any():
            t_s = t_s[:1]
        means = np.empty((len(t_s), len(self.wall), strips), np.float32)
        for n, t in enumerate(t_s.tolist()):
            sums = self._wall_sums(shift_px[n], float(across_px[n]), edges)
            region = self.region(t)
            if region is not None and self._patch_before is not None:
                down, across = region
                cut = np.clip(edges, across.start, across.stop)
                sums[down] += np.diff(self._patch_before[:, cut - across.start])
                sums[down] -= self._wall_sums(shift_px[n], float(across_px[n]), cut)[down]
            means[n] = sums / np.diff(edges)
        return means

    def strip_places(self, strips: int) -> Float32Array:
        """Centroid of each strip's light, −½ to ½ along the line: (lines, strips)."""
        pixels = self.wall.shape[1]
        begins = strip_edges(pixels, strips)[:-1]
        moments = np.add.reduceat(self.wall * places(pixels), begins, axis=1)
        lit = np.maximum(np.add.reduceat(self.wall, begins, axis=1), 1e-6)
        return np.asarray(moments / lit, np.float32)

    def _wall_sums(
        self, shift_px: NDArray[np.float64], across_px: float, edges: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Sums of the displaced wall between edges: (lines, edges − 1)."""
        left, right = _whole_and_rest(across_px)
        held = self._before
        across = (1 - right) * held[:, left + edges] + right * held[:, left + 1 + edges]
        return np.diff(_displaced(across, shift_px, len(self.wall)))

    def _lines(self, level: Float32Array, exponent: float) -> Float32Array:
        lines = np.ascontiguousarray(level.T) if self._turned else level
        return lines if exponent == 1 else WHITE * (lines / WHITE) ** np.float32(exponent)


def _running(levels: Float32Array) -> NDArray[np.float64]:
    """Cumulative sum along each line, up to but not including each pixel."""
    return np.cumsum(np.pad(levels, ((0, 0), (1, 0))), axis=1, dtype=np.float64)


def _displaced(edged: NDArray[Any], shift_px: NDArray[np.float64], lines: int) -> NDArray[Any]:
    """Displace lines of a padded picture by cubic convolution (Keys, IEEE Trans. ASSP 29, 1981).

    ``edged`` has (lines + 2·margin, …), ``shift_px`` (lines,) or (1,).
    """
    top, f = _whole_and_rest(shift_px)
    weights = (
        ((2 - f) * f - 1) * f / 2,
        ((3 * f - 5) * f * f + 2) / 2,
        ((4 - 3 * f) * f + 1) * f / 2,
        (f - 1) * f * f / 2,
    )
    first: Any = top + np.arange(lines)
    out = np.zeros((lines, *edged.shape[1:]), edged.dtype)
    for k, weight in enumerate(weights, -1):
        at = slice(first[0] + k, first[0] + k + lines) if len(top) == 1 else first + k
        out += weight[:, None].astype(edged.dtype) * edged[at]
    return out


def _whole_and_rest(shift_px: NDArray[np.float64] | float) -> tuple[Any, Any]:
    """Displacements as first pixels of the padded wall, and fractions."""
    place = MARGIN_PX - np.clip(shift_px, 2.0 - MARGIN_PX, MARGIN_PX - 2.0)
    whole = place.astype(np.intp)
    return whole, place - whole
