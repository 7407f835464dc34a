"""The effects of a model in one clip, each with its run, by the place where it acts."""

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
    """A model's effects, ready to act on one clip from its first block to its last.

    Parameters
    ----------
    model : CaptureModel
        The capture.
    frames : int
        Frames that are captured.
    seed : int
        Seed of everything random.
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
        """Time the lines of a block of captured frames."""
        read_out = ReadOut.of(self._model.shutter, block, number, clip.start_s[number])
        for effect, run in self._links:
            if isinstance(effect, ReadOutEffect):
                effect.apply(read_out, run)
        return read_out

    def series(self, f0_hz: float) -> NDArray[np.complex128]:
        """Shape the lamp's waveform."""
        series = self._model.light.series(f0_hz)
        for effect, _ in self._links:
            if isinstance(effect, WaveformEffect):
                series = effect.apply(series)
        return series

    @property
    def exponent(self) -> float:
        """Exponent of the camera's power law."""
        exponent = 1.0
        for effect, _ in self._links:
            if isinstance(effect, ToneEffect):
                exponent = effect.apply(exponent)
        return exponent

    def light(self, light: LineLight) -> LineLight:
        """Take light through what acts on it before and in the sensor."""
        for effect, run in self._links:
            if isinstance(effect, LightEffect):
                effect.apply(light, run)
        for effect, run in self._links:
            if isinstance(effect, SensorEffect):
                effect.apply(light, run)
        light.bend(self.exponent)
        return light

    def coded(self, light: LineLight) -> LineLight:
        """Take the light of delivered frames through what stands for an encoder."""
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
