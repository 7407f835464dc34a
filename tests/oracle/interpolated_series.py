"""The paper's ENF of one hypothesis, the slow way: the interpolated series, and its FFT.

The series at ``M·F_r`` samples/s is made, missing rows and all; each window of it is weighted and
transformed whole, and the spectrum's peak near the line refined by a parabola. What stands still
(a mean over the frames so far) is taken off the series before, sample by sample of the period.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def missing_rows(name: str, last: Float, following: Float, gap: int, turns: float) -> Float:
    """Rows between two frames, ``gap`` of them; ``turns`` of the flicker from row to row."""
    rows = last.size
    if name == "neighbour_mean":
        return np.full(gap, (last.mean() + following.mean()) / 2)
    if name == "neighbour_rows":
        return np.array([(last[g % rows] + following[g % rows]) / 2 for g in range(gap)])
    if name == "linear":
        edge = max(round(0.02 * rows), 1)
        ends = [last[-edge:].mean(), following[:edge].mean()]
        return np.interp(np.arange(1, gap + 1), [0, gap + 1], ends)
    if name == "harmonic":
        place = np.concatenate([np.arange(-rows, 0), np.arange(gap, gap + rows)])
        angle = 2 * np.pi * turns * np.concatenate([place, np.arange(gap)])
        basis = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
        known = np.concatenate([last, following])
        found, *_ = np.linalg.lstsq(basis[: 2 * rows], known, rcond=None)
        return np.asarray(basis[2 * rows :] @ found)
    assert name == "none"
    return np.zeros(gap)


def periods_of(
    level: Float, frame_rate_hz: float, nominal_hz: float, idle_ratio: float, interpolation: str
) -> Float:
    """The series, shape (frames, M): each period ends with its frame's rows; none missing."""
    frames, rows = level.shape
    period = round(rows / (1 - idle_ratio))
    turns = 2 * nominal_hz / frame_rate_hz / period
    series = np.zeros((frames, period))
    series[:, period - rows :] = level
    for n in range(1, frames):
        gap = missing_rows(interpolation, level[n - 1], level[n], period - rows, turns)
        series[n, : period - rows] = gap
    return series


def enf_of(
    level: Float,
    frame_rate_hz: float,
    *,
    nominal_hz: float,
    harmonic: int,
    line_hz: float,
    idle_ratio: float,
    interpolation: str,
    windows: int,
    search_hz: float = 0.5,
    window_s: float = 20.0,
) -> tuple[Float, Float]:
    """ENF of the first windows, a second apart, and the line's share of the series' amplitude.

    Parameters
    ----------
    level : ndarray, shape (frames, rows)
        A frame for every period; nothing missing.
    line_hz : float
        Where the line is; below 0 Hz for a folded one.
    """
    series = periods_of(level, frame_rate_hz, nominal_hz, idle_ratio, interpolation)
    frames, period = series.shape
    out, share = [], []
    sample_rate_hz = period * frame_rate_hz
    start_s = (np.arange(frames) * 1.0) / frame_rate_hz
    for k in range(windows):
        before = start_s < k + window_s
        inside = before & (start_s >= k)
        flat = (series[inside] - series[before].mean(axis=0)).reshape(-1)
        frame_s = np.repeat(start_s[inside], period)
        weights = np.cos(np.pi * (frame_s - k - window_s / 2) / window_s) ** 2
        rms = np.sqrt(np.average(flat**2, weights=weights))
        size = 1 << int(np.ceil(np.log2(4 * flat.size)))
        power = np.abs(np.fft.fft(flat * weights, size)) ** 2
        freq_hz = np.fft.fftfreq(size, 1 / sample_rate_hz)
        band = np.flatnonzero(np.abs(freq_hz - line_hz) <= 2 * search_hz * harmonic)
        top = band[np.argmax(power[band])]
        a, b, c = np.log(power[[top - 1, top, (top + 1) % size]])
        step_hz = sample_rate_hz / size
        peak_hz = freq_hz[top] + 0.5 * (a - c) / (a - 2 * b + c) * step_hz
        out.append(nominal_hz + (peak_hz - line_hz) / (2 * harmonic))
        share.append(np.sqrt(2 * power[top]) / weights.sum() / rms)
    return np.array(out), np.array(share)
