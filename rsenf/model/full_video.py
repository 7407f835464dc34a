"""Renders luma frames, faster than real time.

A pixel is its level × light + noise, rounded to 8 bits, one band of lines at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.capture_model import CaptureModel
from rsenf.model.exposures import Capture, ExposedBlock
from rsenf.model.grid import GridPath
from rsenf.model.line_light import LineLight
from rsenf.model.noise import Float32Array, Int64Array, NoiseBank, Sensor, generator
from rsenf.model.row_level import truth_of
from rsenf.model.scene import Region, View, places

# Pixels of a band, so that its floats stay in the processor's cache.
_BAND_PIXELS = 64_000

Luma = NDArray[np.uint8]


class Renderer:
    """Renders the frames of one clip, in the order of their lines.

    Parameters
    ----------
    view : View
        The scene.
    sensor : Sensor
        Determines the noise.
    exponent : float
        Of the camera's tone curve.
    seed : int
        Seed of the noise.
    """

    def __init__(self, view: View, sensor: Sensor, exponent: float, seed: int) -> None:
        self._view, self._sensor, self._exponent = view, sensor, exponent
        self._level = _Canvas(view.wall, view.patch)
        patch_sigma = None if view.patch is None else self._sigma_of(view.patch)
        self._sigma = _Canvas(self._sigma_of(view.wall), patch_sigma)
        self._line_level = view.wall.mean(axis=1)
        self._line_variance = sensor.variance(self._line_level, exponent)
        self._lines, pixels = view.wall.shape
        self._places = places(pixels)
        self._bank = NoiseBank(pixels, seed)
        self._band_lines = max(_BAND_PIXELS // pixels, 1)
        self._light = np.empty((self._band_lines, pixels), np.float32)
        self._luma: Luma = np.empty(view.wall.shape, np.uint8)

    def noise_places(self, rng: np.random.Generator, frames: int) -> Int64Array:
        """Draw the noise of each line of some frames, as positions in the bank: (frames, lines)."""
        return self._bank.places(rng, (frames, self._lines))

    def render(self, exposed: ExposedBlock, frame: int, noise_places: Int64Array) -> Luma:
        """Render one frame of a block: (lines, pixels), valid until the next call.

        Parameters
        ----------
        exposed : ExposedBlock
        frame : int
            Index of the frame in the block.
        noise_places : ndarray of int64 (lines,)
            From :meth:`noise_places`.
        """
        import cv2

        light = exposed.light
        region = self._view.region(float(exposed.start_s[frame]))
        shift = exposed.shift_px[frame], float(exposed.across_px[frame])
        moved = self._view.shifted(*shift) if shift[0].any() or shift[1] else None
        level = self._level.with_patch(region, moved)
        # Noise of the unshifted wall: a shift of a few pixels changes it little.
        sigma = self._sigma.with_patch(region, None)
        louder = self._louder(light.level[frame])
        for top in range(0, self._lines, self._band_lines):
            band = slice(top, min(top + self._band_lines, self._lines))
            lit = self._light[: band.stop - top]
            noise = self._bank.rows(noise_places[band])
            noise *= np.multiply(sigma[band], louder[band, None], out=lit)
            if light.offset is not None:
                noise += light.offset[band, None]
            self._lit(level[band], light, frame, band, lit)
            # Adds, rounds and clips to 0 … 255 in one pass.
            cv2.add(lit, noise, self._luma[band], None, cv2.CV_8U)
        return self._luma

    def _lit(
        self, level: Float32Array, light: LineLight, frame: int, band: slice, out: Float32Array
    ) -> None:
        if light.slope is None:
            np.multiply(level, light.level[frame, band, None], out=out)
            return
        np.multiply(light.slope[frame, band, None], self._places, out=out)
        out += light.level[frame, band, None]
        out *= level

    def _louder(self, gain: Float32Array) -> Float32Array:
        """Factor of the noise due to the light; one per line is enough for a few per cent."""
        variance = self._sensor.variance(self._line_level * gain, self._exponent)
        return np.asarray(np.sqrt(variance / self._line_variance))

    def _sigma_of(self, level: Float32Array) -> Float32Array:
        return np.asarray(np.sqrt(self._sensor.variance(level, self._exponent)), np.float32)


class _Canvas:
    """A picture with a patch that is placed anew in each frame."""

    def __init__(self, ground: Float32Array, patch: Float32Array | None) -> None:
        self._ground, self._patch = ground, patch
        self._picture = ground if patch is None else ground.copy()
        self._covered: Region = (slice(0), slice(0))

    def with_patch(self, region: Region | None, moved: Float32Array | None) -> Float32Array:
        """Return the ground, or the moved one, with the patch in a region."""
        if region is None or self._patch is None:
            return self._picture if moved is None else moved
        if moved is not None:
            moved[region] = self._patch
            return moved
        self._picture[self._covered] = self._ground[self._covered]
        self._picture[region] = self._patch
        self._covered = region
        return self._picture


class FrameStream:
    """The frames of a clip one after the other, in bounded memory.

    Iteration yields ``(pts, luma)``: the presentation time in units of ``time_base`` and a uint8
    array (height_px, width_px), valid until the next one. Each iteration starts again and yields
    the same frames.

    Attributes
    ----------
    truth : dict
        The ground truth of the clip.
    time_base : Fraction
        Seconds of the camera's clock per unit of ``pts``.
    frame_rate : Fraction
        Nominal frame rate.
    frames : int
        Number of frames.
    height_px, width_px : int
        Size of a frame.
    """

    def __init__(self, capture: Capture) -> None:
        shutter = capture.model.shutter
        self._capture = capture
        self.frame_rate = capture.clip.frame_rate
        self.time_base: Fraction = capture.clip.time_base
        self.frames = capture.delivered
        self.height_px, self.width_px = shutter.rows, shutter.columns
        self.truth: dict[str, Any] = truth_of(capture)

    def __iter__(self) -> Iterator[tuple[int, Luma]]:
        capture, turned = self._capture, self._capture.model.shutter.read_out == "columns"
        renderer = Renderer(
            capture.chain().view(), capture.model.sensor, capture.exponent, capture.seed
        )
        for exposed in capture.exposures():
            rng = generator(capture.seed, "noise places", exposed.block)
            places = renderer.noise_places(rng, exposed.captured)
            for n, pts in enumerate(exposed.pts.tolist()):
                luma = renderer.render(exposed, n, places[exposed.index[n]])
                yield pts, np.ascontiguousarray(luma.T) if turned else luma


def render_frames(
    model: CaptureModel, grid: GridPath, duration_s: float | None, seed: int
) -> FrameStream:
    """Film the scene: frames as they leave the sensor, before any codec.

    Parameters
    ----------
    model : CaptureModel
        The capture; its codec isn't used.
    grid : GridPath
        The grid's frequency, and where on it the camera starts.
    duration_s : float or None
        Length of the clip by the camera's clock; None films to the end of the path.
    seed : int
        Seed of all random numbers.

    Raises
    ------
    UsageError
        When the model isn't valid, or the clip doesn't fit on the grid path.
    """
    return FrameStream(Capture(model, grid, duration_s, seed))
