"""Simulated estimates of a clip: the phase of a measured grid with errors of an estimator.

Errors have the kinds and sizes of the flicker's phase in encoded video: white noise, larger than
its stated standard error, slow wander, gaps. They are drawn for every clip, from small to so large
that the phase is useless, for likelihood ratios of every size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.bench.grids import Stretch
from rsenf.bench.scenes import spread
from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.series import Grid, Track
from rsenf.messages.schema import FloatArray

LENGTH_S = (40.0, 240.0)
NOISE_RAD = (1e-3, 0.4)
CLAIMED_RATIO = (1.0, 2.5)  # errors over stated standard errors
WANDER_SHARE, WANDER_RAD, WANDER_S = 0.4, (0.01, 0.2), (3.0, 15.0)
HOLES_SHARE, HOLES = 0.4, (0.05, 0.3)
REFERENCE_HZ = (5e-5, 1e-3)
CLOCK_DOF, CLOCK_PPM = 4.0, 25.0
_MARGIN = 24  # samples beyond each end of a clip
_REACH = 15  # longest smoothing of an estimator of frequency, s


@dataclass(frozen=True)
class Drawn:
    """Properties of a simulated clip."""

    start_s: float
    seconds: int
    noise_rad: float
    claimed_ratio: float
    wander_rad: float
    wander_s: float
    hole_ratio: float
    clock_ppm: float
    reference_hz: float


def draw(stretch: Stretch, rng: np.random.Generator) -> Drawn:
    """Draw the properties of a clip without a gap in the measured grid."""
    seconds = round(spread(rng, LENGTH_S))
    wanders, holes = rng.random() < WANDER_SHARE, rng.random() < HOLES_SHARE
    return Drawn(
        start_s=_start(stretch, seconds, rng),
        seconds=seconds,
        noise_rad=spread(rng, NOISE_RAD),
        claimed_ratio=spread(rng, CLAIMED_RATIO),
        wander_rad=spread(rng, WANDER_RAD) if wanders else 0.0,
        wander_s=spread(rng, WANDER_S),
        hole_ratio=float(rng.uniform(*HOLES)) if holes else 0.0,
        clock_ppm=float(rng.standard_t(CLOCK_DOF) * CLOCK_PPM),
        reference_hz=spread(rng, REFERENCE_HZ),
    )


def _start(stretch: Stretch, seconds: int, rng: np.random.Generator) -> float:
    reach = _MARGIN * stretch.step_s
    while True:
        start = float(rng.uniform(reach, stretch.freq_hz.size * stretch.step_s - seconds - reach))
        if np.isfinite(_samples(stretch, start, seconds)[1]).all():
            return start


def _samples(stretch: Stretch, start_s: float, seconds: float) -> tuple[int, FloatArray]:
    """Return index and values of the samples of an interval, with a margin."""
    first = int(start_s / stretch.step_s) - _MARGIN
    last = int((start_s + seconds) / stretch.step_s) + _MARGIN
    return max(first, 0), stretch.freq_hz[max(first, 0) : last]


def true_phase(stretch: Stretch, start_s: float, t_s: FloatArray, clock_ppm: float) -> FloatArray:
    """Return the illumination's phase relative to the nominal frequency, rad.

    The measured means determine the phase at the ends of their intervals; between those it is a
    cubic spline.

    Parameters
    ----------
    stretch : Stretch
    start_s : float
        Start of the clip in it.
    t_s : ndarray, shape (n,)
        Times of the camera's clock, from the start.
    clock_ppm : float
        Error of that clock.

    Returns
    -------
    ndarray, shape (n,)
    """
    from scipy.interpolate import CubicSpline

    first, freq = _samples(stretch, start_s, float(t_s[-1]))
    edges = np.concatenate([[0.0], np.cumsum(freq - stretch.nominal_hz)]) * stretch.step_s
    path = CubicSpline((first + np.arange(edges.size)) * stretch.step_s, edges)
    true_s = t_s / (1.0 + clock_ppm * 1e-6)
    cycles = path(start_s + true_s) - stretch.nominal_hz * (t_s - true_s)
    return np.asarray(RAD_PER_CYCLE * cycles, np.float64)


def track_of_clip(stretch: Stretch, drawn: Drawn, rng: np.random.Generator) -> Track:
    """Return the estimates of a clip, one a second, each with the phase of that second."""
    t_s = np.asarray(np.arange(drawn.seconds) + 0.5, np.float64)
    true = true_phase(stretch, drawn.start_s, t_s, drawn.clock_ppm)
    errors = drawn.noise_rad * rng.standard_normal(t_s.size)
    errors += _wander(drawn, rng)
    claimed = drawn.noise_rad / drawn.claimed_ratio
    away, smear = _frequency(true, errors, drawn.noise_rad)
    holes = _holes(t_s.size, drawn.hole_ratio, rng)
    wrapped = np.angle(np.exp(1j * (true + errors + rng.uniform(0.0, 2.0 * np.pi))))

    def kept(values: FloatArray) -> FloatArray:
        return np.where(holes, np.nan, values)

    return Track(
        first_s=0.5,
        hop_s=1.0,
        window_s=1.0,
        enf_hz=kept(stretch.nominal_hz + away),
        var_hz2=kept(np.full(t_s.size, max(smear, 2e-5) ** 2)),
        nominal_hz=stretch.nominal_hz,
        phase_rad=kept(wrapped),
        phase_var_rad2=kept(np.full(t_s.size, claimed**2)),
    )


def _wander(drawn: Drawn, rng: np.random.Generator) -> FloatArray:
    keep = math.exp(-1.0 / drawn.wander_s)
    out, state = np.empty(drawn.seconds), rng.standard_normal()
    for i in range(drawn.seconds):
        state = keep * state + math.sqrt(1 - keep**2) * rng.standard_normal()
        out[i] = drawn.wander_rad * state
    return out


def _frequency(
    true_rad: FloatArray, errors_rad: FloatArray, noise_rad: float
) -> tuple[FloatArray, float]:
    """Return the ENF's deviation by an estimator that smooths more with more noise, and its error.

    As coherent projection on encoded clips: 0.5 mHz at 0.02 rad, 1 mHz at 0.1 rad.
    """
    width_s = max(0.3, 1.5 * math.sqrt(noise_rad / 0.02))
    t_s = np.arange(-_REACH, _REACH + 1)
    weights = np.exp(-((t_s / width_s) ** 2) / 2)
    smooth = np.convolve(np.pad(errors_rad, _REACH, mode="edge"), weights / weights.sum(), "valid")
    error = np.gradient(smooth) / RAD_PER_CYCLE
    return np.gradient(true_rad) / RAD_PER_CYCLE + error, float(error.std())


def _holes(count: int, ratio: float, rng: np.random.Generator) -> np.ndarray:
    holes = np.zeros(count, bool)
    while holes.mean() < ratio:
        start = rng.integers(count)
        holes[start : start + rng.integers(1, 6)] = True
    return holes


def measured_reference(stretch: Stretch, drawn: Drawn, rng: np.random.Generator) -> Grid:
    """Return the grid with the noise of a reference, rounded to 0.1 mHz."""
    noise = drawn.reference_hz / math.sqrt(stretch.step_s)
    freq = stretch.freq_hz + noise * rng.standard_normal(stretch.freq_hz.size)
    return Grid(stretch.name, stretch.nominal_hz, 0, stretch.step_s, np.round(freq, 4))
