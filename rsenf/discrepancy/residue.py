"""What is left of the data, summed up for effects to look at."""

from __future__ import annotations

import numpy as np

from rsenf.discrepancy.apart import LINES
from rsenf.discrepancy.fit import Fit
from rsenf.messages.schema import FloatArray
from rsenf.model.effects.residue import Residue

TONES = 1  # lines that are looked at: the others are for the next round
STANDS_OUT = 25.0  # power of a line over the median of the others
ALIASES = 1  # to either side of the likeliest


def residue_of(fit: Fit) -> Residue:
    """Sum up what a fit leaves."""
    data = fit.data
    turn = fit.directions.turn
    flicker = fit.flicker
    seen = data.level - fit.theory.wall.astype(np.float32)
    along = _dot(seen, flicker) / np.maximum(_dot(flicker, flicker), 1e-12)
    across = _dot(seen, turn) / np.maximum(_dot(turn, turn), 1e-12)
    return Residue(
        gap=fit.gap.value,
        turns_per_frame=2.0 * data.nominal_hz / float(data.frame_rate),
        angle_rad=np.arctan2(across, along),
        size_ratio=np.hypot(along, across),
        tones_hz=tones_hz(fit),
    )


def tones_hz(fit: Fit) -> tuple[float, ...]:
    """Frequencies whose light would leave the lines that stand out of the residual.

    Lines are looked for frame by frame and row by row at once: the one transform tells the alias,
    the other, by how fast the phase runs down the rows, which of its aliases it is.
    """
    data, every = fit.data, fit.data.every(LINES)
    frames, down = 2 * data.frames, 4 * data.lines // every
    first, second = (
        np.fft.fft2(half.mean(axis=2), s=(frames, down))
        for half in (fit.residual[data.first], fit.residual[data.second])
    )
    if every > 1:  # the odd rows, moved up by one
        second *= np.exp(-2j * np.pi * np.fft.fftfreq(down) / every)
    power = (first * second.conj()).real
    rate_hz = float(data.frame_rate)
    read_out_s = fit.theory.model.shutter.read_out_time_s
    level = np.median(np.abs(power)) + 1e-30
    out: list[float] = []
    for _ in range(TONES):
        n, i = np.unravel_index(int(np.argmax(power)), power.shape)
        if power[n, i] < STANDS_OUT * level:
            break
        alias_hz = _between(power[:, i], int(n)) * rate_hz / power.shape[0]
        ramp = np.fft.fftfreq(down)[i] * data.lines / every  # turns down a frame
        likely = round((ramp / read_out_s - alias_hz) / rate_hz)
        near = sorted(range(likely - ALIASES, likely + ALIASES + 1), key=lambda m: abs(m - likely))
        out += [alias_hz + m * rate_hz for m in near]
        for sign_n, sign_i in ((n, i), (-n, -i)):
            rows = np.arange(sign_n - 4, sign_n + 5) % power.shape[0]
            columns = np.arange(sign_i - 8, sign_i + 9) % power.shape[1]
            power[np.ix_(rows, columns)] = 0.0
    return tuple(dict.fromkeys(abs(f) for f in out))


def _dot(a: np.ndarray, b: np.ndarray) -> FloatArray:
    return np.asarray((a * b).sum(axis=(1, 2), dtype=np.float64))


def _between(power: FloatArray, at: int) -> float:
    """Place of a peak, to a fraction of a bin."""
    a, b, c = (float(power[(at + k) % power.size]) for k in (-1, 0, 1))
    bend = a - 2.0 * b + c
    return at + (float(np.clip(0.5 * (a - c) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0)
