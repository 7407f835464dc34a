"""The full depth: luma frames, rendered faster than they are filmed."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from rsenf.model.capture_model import CaptureModel
from rsenf.model.exposures import Capture
from rsenf.model.grid import GridPath
from rsenf.model.renderer import Luma, Renderer
from rsenf.model.seeds import generator
from rsenf.model.truth import truth_of


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
        Length of the clip by the camera's clock; None films until the path ends.
    seed : int
        Seed of everything random.

    Raises
    ------
    UsageError
        When the model isn't plausible, or the clip doesn't fit on the grid path.
    """
    return FrameStream(Capture(model, grid, duration_s, seed))
