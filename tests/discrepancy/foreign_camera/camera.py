"""Film a plan: rolling shutter, exposure, electrons and levels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.special import ndtr

from .light import Array, Complex
from .plan import Moment, Plan, Tone

FULL, CHUNK = 255.0, 96


def take(plan: Plan, rng: np.random.Generator, *, noisy: bool = True) -> NDArray[np.float32]:
    """Film all frames and return those that arrive, (frames, rows, strips).

    Without noise, nothing is rounded either.
    """
    level = np.empty((plan.frames, plan.rows, plan.strips), dtype=np.float32)
    sensor = _Digital(plan, rng) if noisy else None
    for first in range(0, plan.frames, CHUNK):
        moment = moment_of(plan, np.arange(first, min(first + CHUNK, plan.frames)))
        part = _wall(plan, moment) * light(plan, moment)
        for change in plan.on_level:
            part = change(moment, part)
        part = sensor(part) if sensor else _curved(plan, np.minimum(part, FULL))
        for change in plan.on_picture:
            part = change(moment, part)
        level[first : first + len(part)] = part
    if plan.mix is not None:
        other, share = plan.mix
        share = share.astype(np.float32)[:, None, None]
        return np.asarray((1 - share) * level[plan.arrive] + share * level[other])
    if np.array_equal(plan.arrive, np.arange(plan.frames)):
        return level
    return level[plan.arrive]


def moment_of(plan: Plan, frame: NDArray[np.int64]) -> Moment:
    """When the rows of some frames are exposed."""
    start_s = plan.start_s[frame]
    late_s = plan.line * plan.readout_s[frame][:, None] + plan.late_s
    t_s = start_s[:, None] + late_s + plan.sensor.exposure_s / 2
    row = np.linspace(0.0, 1.0, plan.rows)
    return Moment(frame=frame, start_s=start_s, t_s=t_s, row=row)


def mains(plan: Plan, moment: Moment) -> Array:
    """Turns of the mains' phase at each row: it runs on evenly within a frame, but for a slope."""
    later_s = moment.t_s - moment.start_s[:, None]
    turns = plan.grid.turns
    at, hz, slope = (turns(moment.start_s, order)[:, None] for order in range(3))
    return np.asarray((at % 1.0) + later_s * (hz + later_s / 2 * slope))


def light(plan: Plan, moment: Moment) -> Array:
    """Light that falls on each row over its exposure, about one; (frames, rows, 1 or strips).

    A lamp's parts and tones are integrated over the exposure exactly, also where they multiply;
    their slow courses are taken at its middle.
    """
    turn = np.exp(2j * np.pi * mains(plan, moment))
    exposure_s, mains_hz = plan.sensor.exposure_s, plan.mains_hz
    total: Array = np.ones((len(moment.frame), 1, 1))
    for shining in plan.lamps:
        part = shining.lamp.exposed(mains_hz, exposure_s).flicker(turn).real
        if shining.course is not None:
            part = part * shining.course(moment.t_s)
        total = total + part[:, :, None] * shining.share
    for tone in plan.tones:
        wave = _wave(tone, moment.t_s)
        shown = (wave * np.sinc(tone.hz * exposure_s)).real
        total = total + shown[:, :, None] * tone.share
        for shining in plan.lamps if tone.times_light else ():
            above = shining.lamp.exposed(mains_hz, exposure_s, beside_hz=tone.hz).flicker(turn)
            below = shining.lamp.exposed(mains_hz, exposure_s, beside_hz=-tone.hz).flicker(turn)
            part = (above * wave + below * wave.conj()).real / 2
            total = total + part[:, :, None] * (shining.share * tone.share)
    return total


def _wave(tone: Tone, t_s: Array) -> Complex:
    angle = 2 * np.pi * ((tone.hz * t_s) % 1.0) + tone.phase_rad
    wave = tone.depth_ratio * np.exp(1j * angle)
    return np.asarray(wave if tone.course is None else wave * tone.course(t_s))


def _wall(plan: Plan, moment: Moment) -> Array:
    if plan.shift_rows is None:
        return plan.wall
    row = np.arange(plan.rows)
    at = np.clip(row - plan.shift_rows(moment), 0, plan.rows - 1)
    return np.asarray(CubicSpline(row, plan.wall)(at))


def _curved(plan: Plan, level: Array) -> Array:
    for curve in plan.curves:
        level = curve(level)
    return level


class _Digital:
    """Electrons to 8-bit levels, as the mean of a row's pixels in a strip has them.

    A pixel has shot noise and read noise in electrons. It holds no more than its well and is
    rounded after the curve. Its noise dithers the rounding: what is left of the steps is a ripple
    of one turn a level, whose size and phase depend on where the pixels of a row happen to stand.
    """

    def __init__(self, plan: Plan, rng: np.random.Generator) -> None:
        self._plan, self._rng = plan, rng
        stand = rng.uniform(size=(plan.rows, plan.strips))
        self._stand = np.exp(2j * np.pi * stand) / np.sqrt(plan.sensor.pixels)

    def __call__(self, light_level: Array) -> Array:
        plan, sensor = self._plan, self._plan.sensor
        per_electron = FULL / sensor.well_electrons
        electrons = np.clip(light_level, 0.0, None) / per_electron
        pixel = np.sqrt(electrons + sensor.read_electrons**2) * per_electron
        level, slope = _held(light_level, pixel)
        if plan.curves:
            slope = slope * (_curved(plan, level + 0.5) - _curved(plan, level - 0.5))
            level = _curved(plan, level)
        variance = (pixel * slope) ** 2
        steps = np.exp(-2 * np.pi**2 * variance)
        if steps.max() > 1e-4:
            turn = np.exp(2j * np.pi * (level % 1.0))
            level = level - (turn * self._stand).imag * steps / np.pi
        of_mean = np.sqrt((variance + 1 / 12) / sensor.pixels)
        level = level + of_mean * self._rng.standard_normal(level.shape, dtype=np.float32)
        common = self._rng.standard_normal((*level.shape[:2], 1), dtype=np.float32)
        return np.asarray(level + sensor.row_noise_level * common)


def _held(level: Array, noise: Array) -> tuple[Array, Array | float]:
    """Mean of noisy pixels cut at the full well, and the share of their noise that is left."""
    if float(level.max()) + 6 * float(noise.max()) < FULL:
        return level, 1.0
    over = (level - FULL) / noise
    under = ndtr(-over)
    density = np.exp(-(over**2) / 2) / np.sqrt(2 * np.pi)
    return level * under + FULL * (1 - under) - noise * density, under
