"""The full depth: luma frames, rendered faster than they are filmed."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.model.capture_model import CaptureModel
from rsenf.model.exposures import Capture
from rsenf.model.grid import GridPath
from rsenf.model.noise import Float32Array, NoiseBank
from rsenf.model.scene import Region, View
from rsenf.model.seeds import generator
from rsenf.model.sensor import Sensor
from rsenf.model.truth import truth_of

# Rows rendered together: their floats stay in the processor's cache.
_BAND_PIXELS = 64_000

Luma = NDArray[np.uint8]


class FrameStream:
    """The frames of a clip, one after the other, in bounded memory.

    Iterating yields ``(pts, luma)``: the presentation time in units of ``time_base`` and a uint8
    array (height_px, width_px), valid until the next one. Each iteration starts anew and yields
    the same frames.

    Attributes
    ----------
    truth : dict
        What is true of the clip.
    time_base : Fraction
        Seconds of the camera's clock per unit of ``pts``.
    frame_rate : Fraction
        Nominal frame rate.
    frames : int
        How many will be yielded.
    height_px, width_px : int
        Size of a frame.
    """

    def __init__(self, capture: Capture) -> None:
        shutter = capture.model.shutter
        self._capture = capture
        self.frame_rate = shutter.frame_rate
        self.time_base: Fraction = 1 / shutter.frame_rate
        self.frames = capture.delivered
        self.height_px, self.width_px = shutter.rows, shutter.columns
        self.truth: dict[str, Any] = truth_of(capture)

    def __iter__(self) -> Iterator[tuple[int, Luma]]:
        capture = self._capture
        view = View(capture.model.scene, self.height_px, self.width_px, capture.seed)
        renderer = _Renderer(view, capture.model.sensor, capture.seed)
        for exposed in capture.exposures():
            rng = generator(capture.seed, "noise places", exposed.block)
            for pts, start_s, gain in zip(
                exposed.stamp.tolist(), exposed.start_s.tolist(), exposed.gain, strict=True
            ):
                yield pts, renderer.render(gain, view.box_region(start_s), rng)


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
        Length of the clip by the camera's clock; None films until the path ends.
    seed : int
        Seed of everything random.

    Raises
    ------
    UsageError
        When the model isn't plausible, or the clip doesn't fit on the grid path.
    """
    return FrameStream(Capture(model, grid, duration_s, seed))


class _Renderer:
    """Levels × light + noise, rounded to bytes, a band of rows at a time."""

    def __init__(self, view: View, sensor: Sensor, seed: int) -> None:
        self._sensor = sensor
        self._level = _Canvas(view.wall, view.box)
        box_sigma = None if view.box is None else np.sqrt(sensor.variance(view.box))
        self._sigma = _Canvas(np.sqrt(sensor.variance(view.wall)), box_sigma)
        self._row_level = view.wall.mean(axis=1)
        self._row_variance = sensor.variance(self._row_level)
        rows, columns = view.wall.shape
        self._bank = NoiseBank(columns, seed)
        self._band_rows = max(_BAND_PIXELS // columns, 1)
        self._light = np.empty((self._band_rows, columns), np.float32)
        self._luma: Luma = np.empty((rows, columns), np.uint8)

    def render(self, gain: Float32Array, box: Region | None, rng: np.random.Generator) -> Luma:
        import cv2

        level, sigma = self._level.with_box(box), self._sigma.with_box(box)
        # Shot noise follows the light; once a row is exact enough for its few per cent.
        louder = np.sqrt(self._sensor.variance(self._row_level * gain) / self._row_variance)
        places = self._bank.places(rng, gain.shape)
        for top in range(0, gain.size, self._band_rows):
            band = slice(top, min(top + self._band_rows, gain.size))
            light = self._light[: band.stop - top]
            noise = self._bank.rows(places[band])
            noise *= np.multiply(sigma[band], louder[band, None], out=light)
            np.multiply(level[band], gain[band, None], out=light)
            # Adds, rounds to the nearest level and clips to 0 … 255, in one pass.
            cv2.add(light, noise, self._luma[band], None, cv2.CV_8U)
        return self._luma


class _Canvas:
    """A picture with a patch that is laid on it anew for each frame."""

    def __init__(self, ground: Float32Array, patch: Float32Array | None) -> None:
        self._ground, self._patch = ground, patch
        self._picture = ground if patch is None else ground.copy()
        self._covered: Region = (slice(0), slice(0))

    def with_box(self, region: Region | None) -> Float32Array:
        if region is not None and self._patch is not None:
            self._picture[self._covered] = self._ground[self._covered]
            self._picture[region] = self._patch
            self._covered = region
        return self._picture
