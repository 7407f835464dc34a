"""What is left of the data, summed up for effects to look at."""

from __future__ import annotations

import numpy as np
from scipy import fft

from rsenf.discrepancy.apart import LINES
from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.theory import plan
from rsenf.messages.schema import FloatArray
from rsenf.model.effects.residue import Residue

STANDS_OUT = 25.0  # power of a line over the median of the others
ALIASES = 1  # to either side of the likeliest
ALIKE_RAMPS = 3  # to either side of it what is left of a harmonic may seem to be
PEAKS = 24  # that are looked at, until one isn't the mains'
SKIRT = 4  # bins of half the resolution to either side of a peak that are its own
BIN_S, ALIKE = 1.0, 0.3  # in which lines' gains are looked at; correlation of their pattern
ALONE = 0.8  # share of what lines' gains have in common that is of one pattern
NEAR_BINS = 2.0  # by which a line may be off a multiple, over one in the length of the recording


def residue_of(fit: Fit) -> Residue:
    """Sum up what a fit leaves."""
    data = fit.data
    turn = fit.slopes.turn
    flicker = fit.flicker
    seen = data.level - fit.theory.wall.astype(np.float32)
    along = _dot(seen, flicker) / np.maximum(_dot(flicker, flicker), 1e-12)
    across = _dot(seen, turn) / np.maximum(_dot(turn, turn), 1e-12)
    return Residue(
        gap=fit.gap.value,
        comb=fit.gap.comb,
        turns_per_frame=2.0 * data.nominal_hz / float(data.frame_rate),
        angle_rad=np.arctan2(across, along),
        size_ratio=np.hypot(along, across),
        tones_hz=tones_hz(fit),
        row_course=row_course(fit),
    )


def tones_hz(fit: Fit) -> tuple[float, ...]:
    """Frequencies whose light would leave the line that stands out most of the residual.

    Lines are looked for frame by frame and row by row at once: the one transform tells the alias,
    the other, by how fast the phase runs down the rows, which of its aliases it is. Of one that is
    too fast for every second row the product of both kinds of rows is below zero. What stands out
    less is for the next round, and what is the mains' own harmonic is no tone.
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
        turns = float(down[i])
        if folded[n, i]:
            alias_hz, turns = -alias_hz, 1.0 - turns
        down_hz = turns * data.lines / every / shutter.read_out_time_s
        likely = round((down_hz - alias_hz) / rate_hz)
        near = sorted(range(likely - ALIASES, likely + ALIASES + 1), key=lambda m: abs(m - likely))
        found = tuple(dict.fromkeys(abs(alias_hz + m * rate_hz) for m in near))
        if not any(is_harmonic(fit, likely_hz) for likely_hz in _near(alias_hz, likely, rate_hz)):
            return found
        power[np.arange(n - SKIRT, n + SKIRT + 1) % size[0]] = 0.0
    return ()


def _near(alias_hz: float, likely: int, rate_hz: float) -> list[float]:
    """Return the frequencies of an alias that run down the rows about as the likeliest does."""
    return [
        abs(alias_hz + m * rate_hz) for m in range(likely - ALIKE_RAMPS, likely + ALIKE_RAMPS + 1)
    ]


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


def is_harmonic(fit: Fit, freq_hz: float) -> bool:
    """Whether light at a frequency may follow the mains: a multiple of the flicker's, or a half."""
    light_hz = 2.0 * fit.theory.course.grid().freq_hz
    mean_hz, width_hz = float(light_hz.mean()), float(np.ptp(light_hz))
    order = max(round(2.0 * freq_hz / mean_hz), 1) / 2.0
    near_hz = order * width_hz / 2.0 + NEAR_BINS / float(fit.data.time_s[-1])
    return abs(freq_hz - order * mean_hz) < near_hz


def _dot(a: np.ndarray, b: np.ndarray) -> FloatArray:
    return np.asarray((a * b).sum(axis=(1, 2), dtype=np.float64))


def _between(power: FloatArray, at: int) -> float:
    """Place of a peak, to a fraction of a bin."""
    a, b, c = (float(power[(at + k) % power.size]) for k in (-1, 0, 1))
    bend = a - 2.0 * b + c
    return at + (float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0)
