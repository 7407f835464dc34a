"""Fit of one window: the tone at each line, the constant beside it, and the flicker's amplitude."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rsenf.flicker.lines import Line
from rsenf.flicker.slow_time import SlowTime
from rsenf.flicker.tone import Tone, ToneFinder
from rsenf.timebase import nanoseconds


@dataclasses.dataclass(frozen=True)
class LineFit:
    """Fit of one window at one line.

    ``constant`` is the texture's projection onto the line, ``noise_level2`` the noise power of a
    single frame (levels²). ``one_sided`` is the tone's power over that at the mirrored alias: large
    for flicker, which runs down the rows in one direction; brightness drift only scales a standing
    pattern, whose spectrum is symmetric about 0 Hz.
    """

    line: Line
    tone: Tone
    constant: complex
    noise_level2: float
    one_sided: float


def fit_lines(
    finder: ToneFinder,
    buffer: SlowTime,
    columns: dict[Line, int],
    start_s: float,
    end_s: float,
    frame_rate_hz: float,
) -> list[LineFit]:
    """Fit the given lines, each in its column of the buffer.

    Lines of one harmonic differ in their ramps only: they share carrier and rotations.

    Parameters
    ----------
    finder : ToneFinder
    buffer : SlowTime
    columns : dict of Line to int
        Column of each line.
    start_s, end_s : float
        The window.
    frame_rate_hz : float
    """
    part = buffer.between(start_s, end_s)
    t_s = buffer.times(part) - (start_s + end_s) / 2.0
    weights = finder.window(t_s)
    out = []
    for carrier_hz in dict.fromkeys(line.carrier_hz for line in columns):
        group = [line for line in columns if line.carrier_hz == carrier_hz]
        carrier = np.exp(-2j * np.pi * carrier_hz * buffer.times(part))
        baseband = buffer.values(part)[:, [columns[x] for x in group]] * carrier[:, None]
        amplitude, power = finder.periodograms(baseband, carrier, t_s)
        means = (weights * carrier.conj()) @ baseband
        for i, line in enumerate(group):
            tone = finder.strongest(power[:, i], t_s)
            peak = int(np.argmax(power[:, i]))
            turn = np.exp(2j * np.pi * finder.offsets_hz[peak] * t_s)
            overlap = (weights * carrier.conj()) @ turn
            noise = tone.amplitude**2 / tone.snr / (weights @ weights) if tone.snr else 0.0
            constant = complex(means[i] - amplitude[peak, i] * overlap)
            mirror_hz = -2.0 * line.alias_hz(frame_rate_hz) - tone.offset_hz
            mirror = np.interp(mirror_hz, finder.offsets_hz, power[:, i], left=0.0, right=0.0)
            one_sided = tone.amplitude**2 / mirror if mirror > 0 else np.inf
            out.append(LineFit(line, tone, constant, float(noise), float(one_sided)))
    return out


def slow_time_amplitude(
    fit: LineFit, buffer: SlowTime, column: int, centre_s: float, hop_s: float
) -> dict[str, Any]:
    """Complex amplitude over the window's middle hop, less the texture.

    Parameters
    ----------
    fit : LineFit
    buffer : SlowTime
    column : int
        The line's column of the buffer.
    centre_s, hop_s : float

    Returns
    -------
    dict
        The amplitude fields of :class:`rsenf.messages.EnfEstimate`; empty without frames.
    """
    part = buffer.between(centre_s - hop_s / 2, centre_s + hop_s / 2)
    count = part.stop - part.start
    if count == 0:
        return {}
    carrier = np.exp(-2j * np.pi * fit.line.carrier_hz * buffer.times(part))
    amplitude = np.mean((buffer.values(part)[:, column] - fit.constant) * carrier)
    variance = np.array([fit.noise_level2 / (2.0 * count)])
    return {
        "carrier_hz": fit.line.carrier_hz,
        "points": 1,
        "amplitude_pts_ns": np.array([buffer.origin_ns + nanoseconds(centre_s)]),
        "amplitude_re": np.array([amplitude.real]),
        "amplitude_im": np.array([amplitude.imag]),
        "amplitude_var_re": variance,
        "amplitude_var_im": variance,
        "amplitude_cov": np.zeros(1),
    }
