"""What is left of the data, summed up for effects to look at."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.forward_model import plan
from rsenf.discrepancy.noise_axis import LINES
from rsenf.messages.schema import FloatArray
from rsenf.model.effects.residue import Residue

ComplexArray = NDArray[np.complexfloating]

STANDS_OUT = 25.0  # power of a line over the median of the others
ALIASES = 1  # to either side of the likeliest
ALIKE_RAMPS = 3  # to either side of it what is left of a harmonic may seem to be
PEAKS = 24  # that are looked at, until one isn't the mains'
SKIRT = 4  # bins of half the resolution to either side of a peak that are its own
BIN_S, ALIKE = 1.0, 0.3  # in which lines' gains are looked at; correlation of their pattern
ALONE = 0.8  # share of what lines' gains have in common that is of one pattern
NEAR_BINS = 2.0  # by which a line may be off a multiple, over one in the length of the recording
ANY_LIGHT = 0.1  # turns down the picture by which a ramp may be off any light's
STILL = 0.5  # of a line's size, that it has with the grid's wander taken out if it follows that


def residue_of(fit: Fit) -> Residue:
    """Sum up what a fit leaves."""
    data = fit.data
    turn = fit.slopes.turn
    flicker = fit.flicker
    seen = data.level - fit.theory.wall.astype(np.float32)
    along = _dot(seen, flicker) / np.maximum(_dot(flicker, flicker), 1e-12)
    across = _dot(seen, turn) / np.maximum(_dot(turn, turn), 1e-12)
    tones_hz, pattern = standing_out(fit)
    return Residue(
        gap=fit.gap.value,
        comb=fit.gap.comb,
        turns_per_frame=2.0 * data.nominal_hz / float(data.frame_rate),
        angle_rad=np.arctan2(across, along),
        size_ratio=np.hypot(along, across),
        tones_hz=tones_hz,
        pattern=pattern,
        row_course=row_course(fit),
    )


def standing_out(fit: Fit) -> tuple[tuple[float, ...], tuple[float, float] | None]:
    """What would leave the line that stands out most: light's frequencies, and else stripes.

    Lines are looked for frame by frame and row by row at once: the one transform tells the alias,
    the other, by how fast the phase runs down the rows, which of its aliases it is. Of one that is
    too fast for every second row the product of both kinds of rows is below zero. What stands out
    less is for the next round, and what is the mains' own harmonic is no tone. Light that has the
    alias can run down the rows in some ways only, a read-out time's turns of the frame rate apart.
    """
    data, every = fit.data, fit.data.every(LINES)
    first = fit.residual[data.first].mean(axis=2)
    second = fit.residual[data.second].mean(axis=2)
    size = tuple(fft.next_fast_len(2 * n) for n in first.shape)
    down = np.fft.rfftfreq(size[1])  # turns from one of these rows to the next
    moved = fft.rfft2(second, s=size)
    if every > 1:  # the odd rows, moved up by one
        moved *= np.exp(-2j * np.pi * down / every).astype(np.complex64)
    power = (fft.rfft2(first, s=size) * moved.conj()).real
    folded = power < 0.0 if every > 1 else np.zeros(power.shape, bool)
    power[folded] *= -1.0
    limit = STANDS_OUT * float(np.median(np.abs(power)))
    rate_hz, shutter = float(data.frame_rate), fit.theory.model.shutter
    for _ in range(PEAKS):
        n, i = np.unravel_index(int(np.argmax(power)), power.shape)
        if power[n, i] < limit:
            break
        alias_hz = _between(power[:, i], int(n)) * rate_hz / size[0]
        turns, exact = float(down[i]), _between(power[n], int(i)) / size[1]
        if folded[n, i]:
            alias_hz, turns, exact = -alias_hz, 1.0 - turns, 1.0 - exact
        down_hz = turns * data.lines / every / shutter.read_out_time_s
        likely = round((down_hz - alias_hz) / rate_hz)
        near = sorted(range(likely - ALIASES, likely + ALIASES + 1), key=lambda m: abs(m - likely))
        found = tuple(dict.fromkeys(abs(alias_hz + m * rate_hz) for m in near))
        column = first @ np.exp(-2j * np.pi * down[i] * np.arange(first.shape[1]))
        column = column.conj() if folded[n, i] else column
        ramps = range(likely - ALIKE_RAMPS, likely + ALIKE_RAMPS + 1)
        if not any(_follows_mains(fit, column, alias_hz, m * rate_hz) for m in ramps):
            return found, _pattern(exact * data.lines / every, alias_hz, fit)
        power[np.arange(n - SKIRT, n + SKIRT + 1) % size[0]] = 0.0
    return (), None


def _pattern(ramp: float, alias_hz: float, fit: Fit) -> tuple[float, float] | None:
    """Stripes, and how many pass in a second, at the slowest; None where it may be light."""
    shutter, rate_hz = fit.theory.model.shutter, float(fit.data.frame_rate)
    alias_hz = math.remainder(alias_hz, rate_hz)
    stripes = ramp - alias_hz * shutter.read_out_time_s  # lines are exposed one after the other
    if abs(math.remainder(stripes, 1.0 - shutter.idle_ratio)) < ANY_LIGHT:
        return None
    return abs(stripes), -math.copysign(alias_hz, alias_hz * stripes)


def _follows_mains(fit: Fit, column: ComplexArray, alias_hz: float, away_hz: float) -> bool:
    """Whether a line, of which a series of frames has the alias, is a harmonic of the mains.

    One is if it is where a harmonic is, and stands out as much with the grid's wander taken out.
    """
    freq_hz = alias_hz + away_hz
    order = harmonic_of(fit, abs(freq_hz))
    if not order:
        return False
    time_s, course = fit.data.time_s, fit.theory.course
    wander_rad = np.interp(time_s, course.node_s, course.psi_rad)
    exact_hz = math.copysign(order * 2.0 * course.nominal_hz, freq_hz) - away_hz
    still = np.abs(np.exp(-2j * np.pi * alias_hz * time_s) @ column)
    angle = 2.0 * np.pi * exact_hz * time_s + math.copysign(order, freq_hz) * wander_rad
    return bool(np.abs(np.exp(-1j * angle) @ column) > STILL * still)


def row_course(fit: Fit) -> FloatArray:
    """Course over time that the gains of the lines have in common, beside that of all of them.

    The first principal component of the lines' gains by seconds, if what one frame in two tells of
    its pattern the others tell, too, and there is little beside it: a pattern that moves is none
    that grows. One value for each captured frame, of rms 1; or empty.
    """
    data, lit = fit.data, fit.slopes.lit
    second = (data.time_s // BIN_S).astype(np.intp)
    gains = (lit * fit.residual).sum(axis=2) / np.maximum((lit * lit).sum(axis=2), 1e-12)
    maps = []
    for part in (0, 1):
        frames = np.arange(part, data.frames, 2)
        count = np.bincount(second[frames], minlength=second[-1] + 1)
        starts = np.searchsorted(second[frames], np.arange(count.size))
        if not count.all():
            return np.empty(0)
        binned = np.add.reduceat(gains[frames], starts, axis=0) / count[:, None]
        binned -= binned.mean(axis=1, keepdims=True)
        maps.append(binned - binned.mean(axis=0))
    found = slice(0, None, data.every(LINES))  # the other lines judge
    course = np.linalg.svd((maps[0] + maps[1])[:, found], full_matrices=False)[0][:, 0]
    one, other = (course @ binned for binned in maps)
    shared, size = float(one @ other), float(np.linalg.norm(one) * np.linalg.norm(other))
    if shared < max(ALIKE * size, ALONE * float((maps[0] * maps[1]).sum())):
        return np.empty(0)
    captured_s = plan(fit.theory.model, data).start_s
    told = np.interp(captured_s, (np.arange(course.size) + 0.5) * BIN_S, course)
    return np.asarray(told / np.sqrt(np.mean(told**2)))


def harmonic_of(fit: Fit, freq_hz: float) -> float:
    """Order of the harmonic, whole or half, that light at a frequency may be of the mains; or 0."""
    light_hz = 2.0 * fit.theory.course.grid().freq_hz
    mean_hz, width_hz = float(light_hz.mean()), float(np.ptp(light_hz))
    order = max(round(2.0 * freq_hz / mean_hz), 1) / 2.0
    near_hz = order * width_hz / 2.0 + NEAR_BINS / float(fit.data.time_s[-1])
    return order if abs(freq_hz - order * mean_hz) < near_hz else 0.0


def _dot(a: np.ndarray, b: np.ndarray) -> FloatArray:
    return np.asarray((a * b).sum(axis=(1, 2), dtype=np.float64))


def _between(power: FloatArray, at: int) -> float:
    """Place of a peak, to a fraction of a bin."""
    a, b, c = (float(power[(at + k) % power.size]) for k in (-1, 0, 1))
    bend = a - 2.0 * b + c
    return at + (float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0)
