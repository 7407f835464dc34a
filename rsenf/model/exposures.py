"""The exposures of a capture, block by block: frames delivered, their times, light on each line.

Row means and rendered frames both start here, so that grid, light, shutter, delivery and effects
are identical to the last bit. :class:`Chain` applies the effects, each at its place of the capture.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.model.capture_model import CaptureModel
from rsenf.model.effects import base
from rsenf.model.grid import FloatArray, GridPath
from rsenf.model.light import Aperture
from rsenf.model.line_light import LineLight
from rsenf.model.scene import View
from rsenf.model.shutter import Clip, Int64Array, ReadOut

BLOCK_FRAMES = 64
FEWEST_VALUES = 1 << 15  # of a block without noise: below, the cost is that of the calls


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
        self._links: list[tuple[base.Effect, base.Run]] = []
        met: Counter[str] = Counter()
        for effect in model.effects:
            label = f"{effect.name} {met[effect.name]}"
            met[effect.name] += 1
            run = base.Run(label, model.shutter, frames, model.scene.level, seed)
            self._links.append((effect, run))

    def _of(self, kind: type[Any]) -> Iterator[tuple[Any, base.Run]]:
        """Yield the effects of a kind, in their order, each with its run."""
        for effect, run in self._links:
            if isinstance(effect, kind):
                yield effect, run

    def clip(self) -> Clip:
        """Plan all frames."""
        clip = Clip.regular(self._model.shutter.frame_rate, self._frames)
        for effect, run in [*self._of(base.FrameEffect), *self._of(base.DeliveryEffect)]:
            effect.apply(clip, run)
        return clip

    def read_out(self, number: Int64Array, clip: Clip) -> ReadOut:
        """Time the lines of a block of captured frames, given their numbers and the clip's plan."""
        read_out = ReadOut.of(self._model.shutter, number, clip.start_s[number])
        for effect, run in self._of(base.ReadOutEffect):
            effect.apply(read_out, run)
        return read_out

    def series(self, f0_hz: float) -> NDArray[np.complex128]:
        """Return the lamp's Fourier series, after effects on the waveform."""
        series = self._model.light.series(f0_hz)
        for effect, _ in self._of(base.WaveformEffect):
            series = effect.apply(series)
        return series

    @property
    def exponent(self) -> float:
        """Exponent of the camera's tone curve."""
        exponent = 1.0
        for effect, _ in self._of(base.ToneEffect):
            exponent = effect.apply(exponent)
        return exponent

    def light(self, light: LineLight) -> LineLight:
        """Apply the effects on light and sensor, and the tone curve."""
        for effect, run in [*self._of(base.LightEffect), *self._of(base.SensorEffect)]:
            effect.apply(light, run)
        light.bend(self.exponent)
        return light

    def coded(self, light: LineLight) -> LineLight:
        """Apply the effects that imitate an encoder, to delivered frames."""
        for effect, run in self._of(base.CodecEffect):
            effect.apply(light, run)
        return light

    def view(self) -> View:
        """Build the scene."""
        shutter = self._model.shutter
        wall = self._model.scene.wall(shutter, self._seed)
        patch = None
        for effect, run in self._of(base.SceneEffect):
            patch = effect.apply(wall, run)
        return View(wall, patch, self.exponent, shutter.read_out == "columns")


@dataclass(frozen=True, eq=False)
class ExposedBlock:
    """The delivered frames of a block of captured frames."""

    block: int
    captured: int  # frames of the block, before delivery
    index: Int64Array  # (frames,) index of each delivered frame among them
    pts: Int64Array  # (frames,) presentation time in units of the clip's time base
    start_s: FloatArray  # (frames,) true time of line 0
    # (frames, 1 or lines) displacement of the scene in the lines' order, and (frames,) across it
    shift_px: FloatArray
    across_px: FloatArray
    light: LineLight  # of the delivered frames


class Capture:
    """A model filming a grid path for some time.

    It takes, and raises, what :func:`rsenf.model.simulate_rows` does; without a duration it films
    to the end of the path.
    """

    def __init__(
        self,
        model: CaptureModel,
        grid: GridPath,
        duration_s: float | None,
        seed: int,
        averaged_rows: int = 1,
    ) -> None:
        model.validate()
        if seed < 0:
            raise UsageError(f"the seed is {seed}, not 0 or more")
        shutter = model.shutter
        self.model, self.grid, self.seed, self.averaged_rows = model, grid, seed, averaged_rows
        self.clock_factor = Chain(model, 1, seed).clip().clock_factor
        if duration_s is None:
            duration_s = (grid.length_s - 1) * self.clock_factor
        self.captured = max(round(duration_s * shutter.frame_rate), 0)
        self.duration_s = float(self.captured / shutter.frame_rate)
        if not self.captured:
            raise UsageError(f"a clip of {duration_s:g} s at {shutter.frame_rate} fps has no frame")
        if self.true_duration_s > grid.length_s:
            raise UsageError(
                f"the clip of {self.duration_s:g} s is longer than the grid path, which has "
                f"{grid.length_s:g} s left at {grid.start_s:g} s",
                "shorten the clip or start it earlier",
            )
        self.phase_rad = model.light.drawn_phase_rad(seed)
        chain = self.chain()
        self.exponent = chain.exponent
        self.clip = chain.clip()
        first = chain.read_out(np.arange(1), self.clip)
        self.read_out_s, self.exposure_s = first.read_out_s, first.exposure_s

    @property
    def true_duration_s(self) -> float:
        """Length of the clip in true seconds."""
        return self.duration_s / self.clock_factor

    @property
    def delivered(self) -> int:
        """Number of frames delivered."""
        return self.clip.number.size

    def chain(self) -> Chain:
        """Return the effects in their initial state."""
        return Chain(self.model, self.captured, self.seed)

    def exposures(self, *, noise: bool = True) -> Iterator[ExposedBlock]:
        """Yield the clip in blocks of 64 captured frames, by which ``noise`` is drawn.

        Without it, those of few lines are longer: effects can't know how a clip is cut.
        """
        lines = self.model.shutter.lines
        each = BLOCK_FRAMES if noise else max(BLOCK_FRAMES, FEWEST_VALUES // lines)
        chain, clip = self.chain(), self.clip
        series = chain.series(2 * self.grid.nominal_hz)
        shutter = self.model.shutter
        step_s = 1 / float(shutter.frame_rate)
        shake_px = self.model.scene.shift_px(self.captured, step_s, self.seed)
        if shutter.read_out == "columns":  # in the order of the read-out
            shake_px = shake_px[:, ::-1]
        pts = clip.pts()
        before: LineLight | None = None
        for block, first in enumerate(range(0, self.captured, each)):
            number = np.arange(first, min(first + each, self.captured))
            read_out = chain.read_out(number, clip)
            start_s = (read_out.start_s[:, None] + read_out.line_s) / self.clock_factor
            row_s = read_out.read_out_s / (shutter.lines * self.averaged_rows)
            aperture = Aperture(
                read_out.exposure_s / self.clock_factor,
                self.averaged_rows,
                row_s / self.clock_factor,
            )
            light = LineLight(
                number, start_s, aperture, self.grid, series, self.phase_rad,
                np.empty(0, np.float32),
            )  # fmt: skip
            light.level = light.lamp()
            begin, end = np.searchsorted(clip.number, [first, first + each])
            index = clip.number[begin:end] - first
            lit = chain.light(light)
            arrived = lit.take(index)
            if clip.blend is not None:
                arrived.blend(lit.frame_before(before).take(index), clip.blend[begin:end])
                before = lit
            yield ExposedBlock(
                block=block,
                captured=number.size,
                index=index,
                pts=pts[begin:end],
                start_s=read_out.start_s[index] / self.clock_factor,
                shift_px=(read_out.shift_px + shake_px[number, :1])[index],
                across_px=shake_px[number, 1][index],
                light=chain.coded(arrived),
            )
