"""Clips of a real camera, degraded by cuts, gaps, noise, quantisation and errors of motion.

The luminance is degraded before it is tracked, and the estimates afterwards. Errors of motion are
those of the same camera in a scene with motion against the reference measured beside it; their
stated standard errors are up to five times too small, as there. Clips for fitting and for testing
are disjoint.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsenf.bench.measure import through
from rsenf.bench.scenes import FIT, TEST, spread
from rsenf.match.clip_phase import RAD_PER_CYCLE
from rsenf.match.series import Grid, Track, track_of
from rsenf.messages import Header
from rsenf.messages.schema import FloatArray
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

FOLDER = "gopro_luminance"
NOMINAL_HZ, CLOCK_PPM = 50.0, 71.0
# Start of each in its references (s), on which two matchers and both references agree; and the clip
# whose errors of motion are added to the others.
LAGS_S = {
    FIT: {"exp_HAL_50cm_wall": 97.8, "exp_HAL_150cm_wall": 70.5, "exp_HAL_300cm_wall": 66.4,
          "experiment_a": 17.1},
    TEST: {"exp_INC_100cm_wall": 63.5, "exp_INC_200cm_wall": 45.5, "exp_INC_350cm_wall": 43.5,
           "experiment_b": 16.8},
}  # fmt: skip
MOVING = {FIT: "experiment_a", TEST: "experiment_b"}
REFERENCES = ("mains", "photodiode")
LENGTH_S = (45.0, 400.0)
LUMINANCE_KINDS = ("noise", "quantised", "gain steps")
TRACK_KINDS = ("thinned", "gap", "motion")
STATED_TOO_SMALL = (1.0, 5.0)


@dataclass(frozen=True, eq=False)
class Degraded:
    """A degraded clip."""

    name: str
    damage: float  # from 0, hardly any, to 1, useless
    kinds: tuple[str, ...]  # of degradation
    track: Track
    reference: str  # of REFERENCES
    lag_s: float  # true start in the reference


@dataclass(frozen=True, eq=False)
class _Clip:
    luminance: FloatArray
    rate_hz: float
    references_hz: dict[str, FloatArray]


def there(folder: Path | None) -> bool:
    """Whether a folder of measured data has the real clips."""
    return folder is not None and (folder / FOLDER).is_dir()


@functools.lru_cache(maxsize=8)
def _clip(folder: Path, name: str) -> _Clip:
    with np.load(folder / FOLDER / f"{name}.npz", allow_pickle=False) as held:
        # The light flickers at twice the mains frequency.
        photodiode_hz = held["photodiode_enf_combined_hz"] / 2.0
        references_hz = {"mains": held["mains_enf_combined_hz"], "photodiode": photodiode_hz}
        luminance, rate_hz = np.asarray(held["luminance"], np.float64), held["frame_rate_hz"]
        return _Clip(luminance, float(rate_hz), references_hz)


def reference_of(folder: Path, name: str, reference: str) -> Grid:
    """Return a reference measured while a clip was filmed."""
    return Grid(reference, NOMINAL_HZ, 0, 1.0, _clip(folder, name).references_hz[reference])


def degraded(folder: Path, part: str, rng: np.random.Generator) -> Degraded:
    """Draw a clip for fitting or for testing, and its degradation."""
    names = tuple(LAGS_S[part])
    name = names[rng.integers(len(names))]
    damage = float(rng.random())
    every = (*LUMINANCE_KINDS, *TRACK_KINDS)
    many = int(rng.integers(1, 2 + round(2 * damage)))
    kinds = tuple(every[i] for i in sorted(rng.choice(len(every), many, replace=False)))
    clip = _clip(folder, name)
    whole_s = clip.luminance.size / clip.rate_hz
    length_s = min(spread(rng, LENGTH_S), whole_s - 1.0)
    begin_s = float(rng.uniform(0.0, whole_s - length_s))
    first, frames = round(begin_s * clip.rate_hz), round(length_s * clip.rate_hz)
    luminance = _worse(clip.luminance[first : first + frames], kinds, damage, rng)
    track = _tracked(luminance, clip.rate_hz)
    for kind in [kind for kind in TRACK_KINDS if kind in kinds]:
        if kind == "motion":
            track = _moved(track, _errors(folder, part), damage, rng)
        else:
            track = _thinned(track, kind, damage, rng)
    lag_s = LAGS_S[part][name] + first / clip.rate_hz / (1.0 + CLOCK_PPM * 1e-6)
    return Degraded(name, damage, kinds, track, REFERENCES[rng.integers(2)], lag_s)


def _worse(
    luminance: FloatArray, kinds: tuple[str, ...], damage: float, rng: np.random.Generator
) -> FloatArray:
    """Degrade the luminance; sizes are relative to the flicker's."""
    size = float(np.diff(luminance).std())
    out = luminance.copy()
    if "gain steps" in kinds:
        for at in rng.integers(out.size, size=1 + round(12 * damage)):
            out[at:] *= math.exp((0.02 + 0.2 * damage) * rng.standard_normal())
    if "noise" in kinds:
        out += size * 10 ** (2.2 * damage - 1.0) * rng.standard_normal(out.size)
    if "quantised" in kinds:
        step = size * 10 ** (1.5 * damage - 0.5)
        out = step * np.round(out / step)
    return out


def _tracked(luminance: FloatArray, rate_hz: float) -> Track:
    stage = make_tracker(TrackSettings(nominal_hz=NOMINAL_HZ))
    level, time_s = luminance[:, None, None], np.arange(luminance.size) / rate_hz
    blocks = blocks_from_luminance(level, time_s, Header(source="real"), read_out_axis="frame")
    return track_of([e for e in through(stage, blocks) if e.rank == 0])


def _thinned(track: Track, kind: str, damage: float, rng: np.random.Generator) -> Track:
    """Remove estimates, in a few gaps or in many."""
    count = track.enf_hz.size
    lost = np.zeros(count, bool)
    if kind == "gap":
        for _ in range(1 + round(2 * damage)):
            start = rng.integers(count)
            lost[start : start + round(count * 0.25 * damage) + 3] = True
    else:
        island = int(rng.integers(3, 12))
        pause = round(island * 4.0 * damage) + 1
        lost = (np.arange(count) + rng.integers(count)) % (island + pause) >= island
    return replace(track, enf_hz=np.where(lost, np.nan, track.enf_hz))


@functools.lru_cache(maxsize=2)
def _errors(folder: Path, part: str) -> tuple[FloatArray, FloatArray]:
    """Return errors of ENF and phase of a moving scene's estimates; NaN without one."""
    from rsenf.match.forecast import forecast

    name = MOVING[part]
    clip, lag_s = _clip(folder, name), LAGS_S[part][name]
    track = _tracked(clip.luminance, clip.rate_hz)
    freq_hz = clip.references_hz["photodiode"]
    t_s = np.asarray(track.first_s + track.hop_s * np.arange(track.enf_hz.size), np.float64)
    enf = track.enf_hz - np.interp(t_s + lag_s - 0.5, np.arange(freq_hz.size), freq_hz)
    enf -= np.nanmedian(enf)
    foretold, _ = forecast(Grid("", NOMINAL_HZ, 0, 1.0, freq_hz), np.array([lag_s]), t_s)
    clock = RAD_PER_CYCLE * CLOCK_PPM * 1e-6 * NOMINAL_HZ * t_s
    phase = np.angle(np.exp(1j * (track.phase_rad - foretold[:, 0] + clock)))
    return enf, phase


def _moved(
    track: Track, errors: tuple[FloatArray, FloatArray], damage: float, rng: np.random.Generator
) -> Track:
    """Add a moving scene's errors to a track, in proportion to the square of the damage."""
    share, (enf, phase) = damage**2, errors
    enf_std_hz, phase_std_rad = np.nanstd(enf), np.nanmedian(np.abs(np.diff(phase)))
    index = (np.arange(track.enf_hz.size) + rng.integers(enf.size)) % enf.size
    enf, phase = enf[index], phase[index]
    stated = share / rng.uniform(*STATED_TOO_SMALL)
    if damage < 0.5:  # above, what the scene lacks is removed as well
        enf, phase = np.nan_to_num(enf), np.where(np.isfinite(enf), phase, 0.0)
    return replace(
        track,
        enf_hz=track.enf_hz + share * enf,
        var_hz2=track.var_hz2 + (stated * enf_std_hz) ** 2,
        phase_rad=np.angle(np.exp(1j * (track.phase_rad + share * phase))),
        phase_var_rad2=track.phase_var_rad2 + (stated * np.nan_to_num(phase_std_rad)) ** 2,
    )
