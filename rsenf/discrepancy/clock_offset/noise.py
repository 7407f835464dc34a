"""Null distribution of estimates minus reference, for a true model, by simulation.

Errors of estimates with overlapping windows are what the tracker makes of white noise of the
measured size; errors of independent estimates have the variance that the tracker states. The
reference's noise is taken as white, of the variance that its second differences show, and passed
through a simulated clip and the tracker: trackers have a prior of grids, and follow noise less than
they follow a grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.clock_offset.clip import SEED, AlignedReference
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel

SETS = 60
TRIED_RATIO, TRIED_HZ = 0.3, 1e-3  # simulated noise: over the flicker, and of the reference
TRIED_S = 100.0  # least duration simulated with a noisy reference
SMOOTH = 6  # bins on either side in a smoothed spectrum
OUTLIER = 6.0  # times the robust standard deviation


@dataclass(frozen=True, eq=False)
class Chance:
    """Simulated data sets without a discrepancy."""

    sets_hz: FloatArray  # (sets, n) estimates minus reference, NaN where there is no estimate
    estimated_hz2: FloatArray  # (sets,) variance of a difference as estimated from each set alone
    # standard deviations of an estimate, averaged as the reference is, and of a reference sample
    estimate_std_hz: float
    reference_std_hz: float

    @property
    def var_hz2(self) -> float:
        """Variance of a difference (Hz²)."""
        return float(np.nanmean(self.sets_hz**2))


@dataclass(frozen=True, eq=False)
class Tracked:
    """Response of the tracker to noise."""

    # errors due to the frames' noise; empty if each estimate states its own variance
    estimate_hz: FloatArray
    reference_ratio: FloatArray  # errors due to white noise of unit variance in the reference


def tracked_noise(
    beside: AlignedReference, model: CaptureModel, lag_s: float, said_hz: FloatArray
) -> Tracked:
    """Simulate the tracker's response to noise of frames and reference.

    Parameters
    ----------
    beside : AlignedReference
    model : CaptureModel
    lag_s : float
    said_hz : ndarray (n,)
        The tracker's estimates without noise.
    """
    rng, path_hz = np.random.default_rng(SEED), beside.path_hz
    ratios = []
    for _ in range(math.ceil(TRIED_S / beside.clip.duration_s)):
        noisy_hz = path_hz + TRIED_HZ * rng.standard_normal(path_hz.size)
        estimates = beside.clip.film(model, beside.path(lag_s, noisy_hz))
        ratios.append((beside.on_axis(estimates) - said_hz) / TRIED_HZ)
    ratio = np.concatenate(ratios)
    ratio = ratio[np.isfinite(ratio)]
    if not beside.overlap:
        return Tracked(np.empty(0), ratio)
    estimates = beside.clip.film(model, beside.path(lag_s), TRIED_RATIO)
    tried_db = float(np.median([e.snr_db for e in estimates if e.usable]))
    errors = (beside.on_axis(estimates) - said_hz) * 10.0 ** ((tried_db - beside.snr_db) / 20.0)
    return Tracked(errors[np.isfinite(errors)], ratio)


def chance_of(beside: AlignedReference, tracked: Tracked, residual_hz: FloatArray) -> Chance:
    """Draw data sets that a model explains.

    Parameters
    ----------
    beside : AlignedReference
    tracked : Tracked
    residual_hz : ndarray (n,)
        Of the model.
    """
    rng, size = np.random.default_rng(SEED), residual_hz.size
    estimates = np.array([beside.read(e) for e in _estimate_errors(beside, tracked, rng)])
    unit = _alike(tracked.reference_ratio, size, rng)
    if beside.overlap:  # the windows have removed noise from the residual: use the reference
        first = int(beside.start_s(beside.lag_s) / beside.grid.step_s)
        samples = int(beside.clip.duration_s / beside.grid.step_s)
        reference_var = roughness(beside.path_hz[first : first + samples])
        estimated_var = np.full(SETS, reference_var)
    else:
        own_var = float(np.mean([roughness(e) for e in estimates]))
        per_unit = float(np.mean([roughness(u) for u in unit]))
        reference_var = max(roughness(residual_hz) - own_var, 0.0) / per_unit
    sets = estimates + np.sqrt(reference_var) * unit
    sets[:, ~np.isfinite(residual_hz)] = np.nan
    if not beside.overlap:
        estimated_var = np.array([max(roughness(one) - own_var, 0.0) / per_unit for one in sets])
    estimated_hz2 = np.nanvar(estimates) + estimated_var * unit.var()
    return Chance(sets, estimated_hz2, float(np.nanstd(estimates)), float(np.sqrt(reference_var)))


def _estimate_errors(
    beside: AlignedReference, tracked: Tracked, rng: np.random.Generator
) -> FloatArray:
    """Draw errors of the tracker's estimates, (sets, n)."""
    size = beside.track.enf_hz.size
    if not beside.overlap:
        std_hz = np.sqrt(beside.track.var_hz2)
        errors = std_hz * rng.standard_normal((SETS, size))
    else:
        errors = _alike(tracked.estimate_hz, size, rng)
    errors[:, ~np.isfinite(beside.track.enf_hz)] = np.nan
    return errors


def _alike(errors: FloatArray, size: int, rng: np.random.Generator) -> FloatArray:
    """Draw series of the same spectrum, with random phases, (sets, size)."""
    power = np.abs(np.fft.rfft(errors, 2 * errors.size)) ** 2
    # The periodogram of one simulation is noisy; smoothing estimates the spectrum.
    around = np.concatenate([power[SMOOTH:0:-1], power, power[-2 : -2 - SMOOTH : -1]])
    smooth = np.convolve(around, np.ones(2 * SMOOTH + 1) / (2 * SMOOTH + 1), "valid")
    turns = rng.uniform(0.0, 2.0 * np.pi, (SETS, smooth.size))
    drawn = np.fft.irfft(np.sqrt(smooth) * np.exp(1j * turns), 2 * errors.size, axis=1)
    drawn *= errors.std() / drawn.std()
    return np.asarray(np.resize(drawn.T, (size, SETS)).T.copy())


def roughness(values: FloatArray) -> float:
    """Variance of white noise with the same mean square second difference; 0 if too few are known.

    Examples
    --------
    >>> round(roughness(np.array([1.0, -1.0] * 10)), 3)
    2.667
    """
    bend = np.diff(values, 2)
    bend = bend[np.isfinite(bend)]
    if bend.size < 3:
        return 0.0
    # Outliers, such as steps, aren't noise.
    usual = 1.4826 * float(np.median(np.abs(bend)))
    return float((bend[np.abs(bend) <= OUTLIER * usual] ** 2).mean() / 6.0)
