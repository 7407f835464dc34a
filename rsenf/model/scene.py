"""The scene: a textured wall, filmed by a camera that may shake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.model.parameters import ParameterError, parameter
from rsenf.model.seeds import generator
from rsenf.model.sensor import WHITE
from rsenf.model.shutter import Shutter
from rsenf.model.strips import strip_edges
from rsenf.model.wander import wander

Float32Array = NDArray[np.float32]

_DARKEST, _BRIGHTEST = 4.0, 240.0  # headroom for noise and flicker within 8 bits


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
