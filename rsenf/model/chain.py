"""The effects of a model in one clip, applied stage by stage."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from rsenf.model.capture_model import CaptureModel
from rsenf.model.clip import Clip, Int64Array
from rsenf.model.effects import (
    CodecEffect,
    DeliveryEffect,
    Effect,
    FrameEffect,
    LightEffect,
    ReadOutEffect,
    Run,
    SceneEffect,
    SensorEffect,
    ToneEffect,
    WaveformEffect,
)
from rsenf.model.line_light import LineLight
from rsenf.model.readout import ReadOut
from rsenf.model.view import View


class Chain:
    """A model's effects, ready for one clip from its first block to its last; they keep state.

    Parameters
    ----------
    model : CaptureModel
        The capture.
    frames : int
        Captured frames.
    seed : int
        Seed of all random numbers.
    """

    def __init__(self, model: CaptureModel, frames: int, seed: int) -> None:
        self._model, self._frames, self._seed = model, frames, seed
        self._links: list[tuple[Effect, Run]] = []
        met: Counter[str] = Counter()
        for effect in model.effects:
            label = f"{effect.name} {met[effect.name]}"
            met[effect.name] += 1
            run = Run(label, model.shutter, frames, model.scene.level, seed)
            self._links.append((effect, run))

    def clip(self) -> Clip:
        """Plan all frames."""
        clip = Clip.regular(self._model.shutter.frame_rate, self._frames)
        for effect, run in self._links:
            if isinstance(effect, FrameEffect):
                effect.apply(clip, run)
        for effect, run in self._links:
            if isinstance(effect, DeliveryEffect):
                effect.apply(clip, run)
        return clip

    def read_out(self, block: int, number: Int64Array, clip: Clip) -> ReadOut:
        """Time the lines of a block of captured frames, given their numbers and the clip's plan."""
        read_out = ReadOut.of(self._model.shutter, block, number, clip.start_s[number])
        for effect, run in self._links:
            if isinstance(effect, ReadOutEffect):
                effect.apply(read_out, run)
        return read_out

    def series(self, f0_hz: float) -> NDArray[np.complex128]:
        """Return the lamp's Fourier series, after effects on the waveform."""
        series = self._model.light.series(f0_hz)
        for effect, _ in self._links:
            if isinstance(effect, WaveformEffect):
                series = effect.apply(series)
        return series

    @property
    def exponent(self) -> float:
        """Exponent of the camera's tone curve."""
        exponent = 1.0
        for effect, _ in self._links:
            if isinstance(effect, ToneEffect):
                exponent = effect.apply(exponent)
        return exponent

    def light(self, light: LineLight) -> LineLight:
        """Apply the effects on light and sensor, and the tone curve."""
        for effect, run in self._links:
            if isinstance(effect, LightEffect):
                effect.apply(light, run)
        for effect, run in self._links:
            if isinstance(effect, SensorEffect):
                effect.apply(light, run)
        light.bend(self.exponent)
        return light

    def coded(self, light: LineLight) -> LineLight:
        """Apply the effects that imitate an encoder, to delivered frames."""
        for effect, run in self._links:
            if isinstance(effect, CodecEffect):
                effect.apply(light, run)
        return light

    def view(self) -> View:
        """Build the scene."""
        shutter = self._model.shutter
        wall = self._model.scene.wall(shutter, self._seed)
        patch = None
        for effect, run in self._links:
            if isinstance(effect, SceneEffect):
                patch = effect.apply(wall, run)
        return View(wall, patch, self.exponent, shutter.read_out == "columns")
