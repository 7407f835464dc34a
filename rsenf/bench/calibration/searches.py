"""One simulated clip searched for in a reference with its time, and without it: raw ratios.

The estimates of a clip are the phase of a measured grid with errors of the kinds and sizes in
encoded video: white noise, larger than its stated standard error, slow wander, gaps. They are drawn
for every clip, from small to so large that the phase is useless, for likelihood ratios of every
size.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.calibration.real_clips import LAGS_S, degraded, reference_of
from rsenf.bench.measure import number
from rsenf.bench.scenes import CLOCK_FREEDOM, CLOCK_PPM, spread, stretch_of, stretches
from rsenf.match.clip_phase import RAD_PER_CYCLE, clip_phase
from rsenf.match.ou_likelihood import inliers
from rsenf.match.phase import least_log10_lr, weigh, weigh_claim
from rsenf.match.phase_search import PhaseSearch, search_phase
from rsenf.match.series import Grid, Track, without_jumps
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray
from rsenf.model.noise import generator, wander

LENGTH_S = (40.0, 240.0)
NOISE_RAD = (1e-3, 0.4)
CLAIMED_RATIO = (1.0, 2.5)  # errors over stated standard errors
WANDER_SHARE, WANDER_RAD, WANDER_S = 0.4, (0.01, 0.2), (3.0, 15.0)
HOLES_SHARE, HOLES = 0.4, (0.05, 0.3)
REFERENCE_HZ = (5e-5, 1e-3)
VERSION = 2
AWAY_S = 600.0  # margin around a clip's time that is removed from the reference
FALSE_CLAIMS = 4
PLACE_S = 3.0  # largest error of a correct place
SPAN_H = (2.0, 24.0)  # length of the reference
REAL_SPAN_H = 3.0  # length of a reference without the real clip
_MARGIN = 24  # samples beyond each end of a clip
_REACH = 15  # longest smoothing of an estimator of frequency, s


@dataclass(frozen=True)
class DrawnClip:
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


def _draw(stretch: Grid, rng: np.random.Generator) -> DrawnClip:
    """Draw the properties of a clip without a gap in the measured grid."""
    seconds = round(spread(rng, LENGTH_S))
    wanders, holes = rng.random() < WANDER_SHARE, rng.random() < HOLES_SHARE
    return DrawnClip(
        start_s=_start(stretch, seconds, rng), seconds=seconds, noise_rad=spread(rng, NOISE_RAD),
        claimed_ratio=spread(rng, CLAIMED_RATIO),
        wander_rad=spread(rng, WANDER_RAD) if wanders else 0.0, wander_s=spread(rng, WANDER_S),
        hole_ratio=float(rng.uniform(*HOLES)) if holes else 0.0,
        clock_ppm=float(rng.standard_t(CLOCK_FREEDOM) * CLOCK_PPM),
        reference_hz=spread(rng, REFERENCE_HZ),
    )  # fmt: skip


def _start(stretch: Grid, seconds: int, rng: np.random.Generator) -> float:
    reach = _MARGIN * stretch.step_s
    while True:
        start = float(rng.uniform(reach, stretch.duration_s - seconds - reach))
        if np.isfinite(_samples(stretch, start, seconds)[1]).all():
            return start


def _samples(stretch: Grid, start_s: float, seconds: float) -> tuple[int, FloatArray]:
    """Return index and values of the samples of an interval, with a margin."""
    first = int(start_s / stretch.step_s) - _MARGIN
    last = int((start_s + seconds) / stretch.step_s) + _MARGIN
    return max(first, 0), stretch.freq_hz[max(first, 0) : last]


def true_phase(stretch: Grid, start_s: float, t_s: FloatArray, clock_ppm: float) -> FloatArray:
    """Return the illumination's phase relative to the nominal frequency, rad.

    The measured means determine the phase at the ends of their intervals; between those it is a
    cubic spline.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Times of the camera's clock, from the clip's start ``start_s`` in the stretch.
    """
    from scipy.interpolate import CubicSpline

    first, freq = _samples(stretch, start_s, float(t_s[-1]))
    edges = np.concatenate([[0.0], np.cumsum(freq - stretch.nominal_hz)]) * stretch.step_s
    path = CubicSpline((first + np.arange(edges.size)) * stretch.step_s, edges)
    true_s = t_s / (1.0 + clock_ppm * 1e-6)
    cycles = path(start_s + true_s) - stretch.nominal_hz * (t_s - true_s)
    return np.asarray(RAD_PER_CYCLE * cycles, np.float64)


def track_of_clip(stretch: Grid, drawn: DrawnClip, rng: np.random.Generator) -> Track:
    """Return the estimates of a clip, one a second, each with the phase of that second."""
    t_s = np.asarray(np.arange(drawn.seconds) + 0.5, np.float64)
    true = true_phase(stretch, drawn.start_s, t_s, drawn.clock_ppm)
    errors = drawn.noise_rad * rng.standard_normal(t_s.size)
    # Without the first value, which is drawn before the clip.
    errors += drawn.wander_rad * wander(rng, t_s.size + 1, 1.0, drawn.wander_s)[1:]
    claimed = drawn.noise_rad / drawn.claimed_ratio
    away, smear = _frequency(true, errors, drawn.noise_rad)
    kept = np.where(_holes(t_s.size, drawn.hole_ratio, rng), np.nan, 1.0)
    wrapped = np.angle(np.exp(1j * (true + errors + rng.uniform(0.0, 2.0 * np.pi))))
    return Track(
        first_s=0.5, hop_s=1.0, window_s=1.0, nominal_hz=stretch.nominal_hz,
        enf_hz=kept * (stretch.nominal_hz + away), var_hz2=kept * max(smear, 2e-5) ** 2,
        phase_rad=kept * wrapped, phase_var_rad2=kept * claimed**2,
    )  # fmt: skip


def _frequency(
    true_rad: FloatArray, errors_rad: FloatArray, noise_rad: float
) -> tuple[FloatArray, float]:
    """Return the ENF's deviation by an estimator that smooths more with more noise, and its error.

    As coherent projection on encoded clips: 0.5 mHz at 0.02 rad, 1 mHz at 0.1 rad.
    """
    from scipy.ndimage import gaussian_filter1d

    width_s = max(0.3, 1.5 * math.sqrt(noise_rad / 0.02))
    smooth = gaussian_filter1d(errors_rad, width_s, mode="nearest", radius=_REACH)
    error = np.gradient(smooth) / RAD_PER_CYCLE
    return np.gradient(true_rad) / RAD_PER_CYCLE + error, float(error.std())


def _holes(count: int, ratio: float, rng: np.random.Generator) -> np.ndarray:
    holes = np.zeros(count, bool)
    while holes.mean() < ratio:
        start = rng.integers(count)
        holes[start : start + rng.integers(1, 6)] = True
    return holes


def measured_reference(stretch: Grid, drawn: DrawnClip, rng: np.random.Generator) -> Grid:
    """Return the grid with the noise of a reference, rounded to 0.1 mHz."""
    noise = drawn.reference_hz / math.sqrt(stretch.step_s)
    freq = stretch.freq_hz + noise * rng.standard_normal(stretch.freq_hz.size)
    return dataclasses.replace(stretch, freq_hz=np.round(freq, 4))


def searched(part: str, seed: int, folder: Path) -> dict[str, Any]:
    """Draw a clip from a seed, search for it, and return the result with the truth.

    Parameters
    ----------
    part : {'fit', 'test'}
    seed : int
    folder : Path
        Of measured data.
    """
    rng = generator(seed, part)
    stretch = _shortened(stretch_of(folder, part, rng), rng)
    drawn = _draw(stretch, rng)
    track = track_of_clip(stretch, drawn, rng)
    grid = measured_reference(stretch, drawn, rng)
    facts = {"grid": stretch.name, "hours": round(grid.duration_s / 3600, 2)}
    facts |= {"part": part, "seed": seed, **dataclasses.asdict(drawn)}
    record, found = _searches(facts, track, [grid])
    return record | _answers(found[0], grid, drawn, rng) if found else record


def _searches(
    facts: dict[str, Any], track: Track, grids: Sequence[Grid]
) -> tuple[dict[str, Any], list[PhaseSearch]]:
    """Return what all records have, and a search of each grid if enough seconds are usable."""
    phases, settings = clip_phase(track), MatchSettings()
    record = {"version": VERSION, **facts}
    if phases is None or track.usable < settings.min_seconds:
        return record | {"usable": False}, []
    sure = phases.only(inliers(phases))
    found = [search_phase(track, sure, [grid], settings) for grid in grids]
    return record | {"usable": True, "least": least_log10_lr(phases)}, found


def real_searched(part: str, seed: int, folder: Path) -> dict[str, Any]:
    """Degrade a real clip, search for it, and return the result with the truth.

    It is searched for in the reference measured while it was filmed, and in two that lack it.

    Parameters
    ----------
    part, seed, folder
        As of :func:`searched`.
    """
    rng = generator(seed, f"real {part} {seed}")
    clip = degraded(folder, part, rng)
    track, _ = without_jumps(clip.track)
    others = [name for name in LAGS_S[part] if name != clip.name]
    beside = reference_of(folder, others[rng.integers(len(others))], clip.reference)
    day = _hours(stretches(folder, part)[0], rng)
    grids = [reference_of(folder, clip.name, clip.reference), beside, day]
    facts = {"part": part, "seed": seed, "grid": clip.name, "kinds": clip.kinds,
             "damage": clip.damage, "seconds": track.usable}  # fmt: skip
    record, searches = _searches(facts, track, grids)
    if not searches:
        return record
    found, *absent = searches
    return record | {
        "present": _best(found, clip.lag_s),
        "absent": _best(absent[0], math.nan),
        "absent_day": _best(absent[1], math.nan),
        "true_claim": _claimed(found, clip.lag_s + rng.uniform(-0.5, 0.5)),
        "false_claims": [
            _claimed(search, float(rng.uniform(0.0, search.scorers[0].grid.duration_s / 2)))
            for search in absent
            for _ in range(FALSE_CLAIMS // 2)
        ],
    }


def _hours(stretch: Grid, rng: np.random.Generator) -> Grid:
    samples = round(REAL_SPAN_H * 3600 / stretch.step_s)
    first = int(rng.integers(stretch.freq_hz.size - samples))
    return dataclasses.replace(stretch, freq_hz=stretch.freq_hz[first : first + samples])


def _shortened(stretch: Grid, rng: np.random.Generator) -> Grid:
    """Cut a random part: searches have different sizes."""
    span = int(rng.uniform(*SPAN_H) * 3600 / stretch.step_s)
    if span >= stretch.freq_hz.size:
        return stretch
    while True:
        first = int(rng.integers(stretch.freq_hz.size - span))
        freq = stretch.freq_hz[first : first + span]
        if np.isfinite(freq).mean() > 0.5:
            return dataclasses.replace(stretch, freq_hz=freq)


def _answers(
    found: PhaseSearch, grid: Grid, drawn: DrawnClip, rng: np.random.Generator
) -> dict[str, Any]:
    # Without the places near the true time, it is a search of a reference that lacks it.
    elsewhere = [p for p in found.places if abs(p.lag_s - drawn.start_s) > AWAY_S + drawn.seconds]
    absent = dataclasses.replace(found, places=elsewhere)
    true_claim = drawn.start_s + rng.uniform(-0.5, 0.5)
    room = grid.duration_s - drawn.seconds
    false_claims = [c for c in rng.uniform(0, room, FALSE_CLAIMS) if abs(c - drawn.start_s) > 30]
    # The hardest false claim: the best wrong time.
    false_claims += [elsewhere[0].lag_s] if elsewhere else []
    return {
        "present": _best(found, drawn.start_s, drawn.clock_ppm),
        "absent": _best(absent, drawn.start_s, drawn.clock_ppm),
        "true_claim": _claimed(found, true_claim),
        "false_claims": [_claimed(found, float(c)) for c in false_claims],
    }


def _claimed(found: PhaseSearch, lag_s: float) -> float | None:
    raw, _ = weigh_claim(found, 0, lag_s, MatchSettings())
    return raw if np.isfinite(raw) else None


def _best(found: PhaseSearch, start_s: float, clock_ppm: float = math.nan) -> dict[str, Any] | None:
    """Return the best place and its errors; the start is NaN if the reference lacks it."""
    if not found.places:
        return None
    raw, place, scorer = weigh(found), found.places[0], found.scorers[0]
    clock, nominal_hz = scorer.clocks(np.array([place.lag_s]))[0], scorer.grid.nominal_hz
    error_s = place.lag_s - start_s
    return {
        "other": raw.other,
        "absent": raw.absent,
        "score": place.score,
        "right": abs(error_s) <= PLACE_S,
        "lag_error_s": number(error_s),
        "lag_std_s": place.lag_std_s,
        "clock_error_ppm": number(-clock.offset_hz / nominal_hz * 1e6 - clock_ppm),
        "clock_std_ppm": clock.offset_std_hz / nominal_hz * 1e6,
    }
