"""One clip searched for in a reference with its time, and without it: raw likelihood ratios."""

from __future__ import annotations

import dataclasses
import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.calibration.clips import Drawn, draw, measured_reference, track_of_clip
from rsenf.bench.calibration.real_clips import LAGS_S, degraded, reference_of
from rsenf.bench.grids import Stretch, stretches
from rsenf.bench.judge import number
from rsenf.match.clip_phase import clip_phase
from rsenf.match.ou_likelihood import inliers
from rsenf.match.phase import least_log10_lr, weigh, weigh_claim
from rsenf.match.phase_search import PhaseSearch, search_phase
from rsenf.match.series import Grid, Track, without_jumps
from rsenf.match.settings import MatchSettings

VERSION = 2
AWAY_S = 600.0  # margin around a clip's time that is removed from the reference
FALSE_CLAIMS = 4
PLACE_S = 3.0  # largest error of a correct place
SPAN_H = (2.0, 24.0)  # length of the reference
REAL_SPAN_H = 3.0  # length of a reference without the real clip


@dataclass(frozen=True)
class Search:
    """A search; all its properties are drawn from its seed."""

    part: str
    seed: int
    folder: Path

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"{self.part} {self.seed}"


def searched(task: Search) -> dict[str, Any]:
    """Draw a clip, search for it, and return the result with the truth.

    One search gives both results: without the places near the true time, it is a search of a
    reference that lacks it.
    """
    rng = np.random.default_rng([task.seed, zlib.crc32(task.part.encode())])
    everything = stretches(task.folder, task.part)
    # Half of the clips are in the first stretch, a long one; the others are many short ones.
    other = rng.integers(1, len(everything)) if len(everything) > 1 else 0
    stretch = everything[0 if rng.random() < 0.5 else other]
    stretch = _shortened(stretch, rng)
    drawn = draw(stretch, rng)
    track = track_of_clip(stretch, drawn, rng)
    grid = measured_reference(stretch, drawn, rng)
    record = {
        "version": VERSION,
        "key": task.key,
        "part": task.part,
        "seed": task.seed,
        "grid": stretch.name,
        "hours": round(grid.duration_s / 3600, 2),
        **dataclasses.asdict(drawn),
    }
    settings = MatchSettings()
    phases = clip_phase(track)
    if phases is None or track.usable < settings.min_seconds:
        return record | {"usable": False}
    found = search_phase(track, phases.only(inliers(phases)), [grid], settings)
    return record | {
        "usable": True,
        "least": least_log10_lr(phases),
        **_answers(found, grid, drawn, settings, rng),
    }


class RealSearch(Search):
    """A search for a degraded real clip; all its properties are drawn from its seed."""

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"real {self.part} {self.seed}"


def real_searched(task: RealSearch) -> dict[str, Any]:
    """Degrade a real clip, search for it, and return the result with the truth.

    It is searched for in the reference measured while it was filmed, and in two that lack it: the
    reference of another clip, and some hours of a measured grid.
    """
    rng = np.random.default_rng([task.seed, zlib.crc32(task.key.encode())])
    clip = degraded(task.folder, task.part, rng)
    track, _ = without_jumps(clip.track)
    others = [name for name in LAGS_S[task.part] if name != clip.name]
    elsewhere = [
        reference_of(task.folder, others[rng.integers(len(others))], clip.reference),
        _day(task, rng),
    ]
    record = {
        "version": VERSION,
        "key": task.key,
        "part": task.part,
        "seed": task.seed,
        "grid": clip.name,
        "kinds": clip.kinds,
        "damage": clip.damage,
        "seconds": track.usable,
    }
    settings, phases = MatchSettings(), clip_phase(track)
    if phases is None or track.usable < settings.min_seconds:
        return record | {"usable": False}
    grid = reference_of(task.folder, clip.name, clip.reference)
    found = search_phase(track, phases.only(inliers(phases)), [grid], settings)
    absent = [_of_search(track, other, settings) for other in elsewhere]
    claims = [_claimed(found, clip.lag_s + rng.uniform(-0.5, 0.5), settings)]
    claims += [
        _claimed(search, float(rng.uniform(0.0, search.scorers[0].grid.duration_s / 2)), settings)
        for search in absent
        for _ in range(FALSE_CLAIMS // 2)
    ]
    return record | {
        "usable": True,
        "least": least_log10_lr(phases),
        "present": _best(found, clip.lag_s),
        "absent": _best(absent[0], math.nan),
        "absent_day": _best(absent[1], math.nan),
        "true_claim": claims[0],
        "false_claims": claims[1:],
    }


def _day(task: RealSearch, rng: np.random.Generator) -> Grid:
    stretch = stretches(task.folder, task.part)[0]
    samples = round(REAL_SPAN_H * 3600 / stretch.step_s)
    first = int(rng.integers(stretch.freq_hz.size - samples))
    freq_hz = stretch.freq_hz[first : first + samples]
    return Grid(stretch.name, stretch.nominal_hz, 0, stretch.step_s, freq_hz)


def _of_search(track: Track, grid: Grid, settings: MatchSettings) -> PhaseSearch:
    phases = clip_phase(track)
    assert phases is not None
    return search_phase(track, phases.only(inliers(phases)), [grid], settings)


def _shortened(stretch: Stretch, rng: np.random.Generator) -> Stretch:
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
    found: PhaseSearch, grid: Grid, drawn: Drawn, settings: MatchSettings, rng: np.random.Generator
) -> dict[str, Any]:
    present = _best(found, drawn.start_s, drawn.clock_ppm)
    elsewhere = [p for p in found.places if abs(p.lag_s - drawn.start_s) > AWAY_S + drawn.seconds]
    absent = _best(dataclasses.replace(found, places=elsewhere), drawn.start_s, drawn.clock_ppm)
    true_claim = drawn.start_s + rng.uniform(-0.5, 0.5)
    room = grid.duration_s - drawn.seconds
    false_claims = [c for c in rng.uniform(0, room, FALSE_CLAIMS) if abs(c - drawn.start_s) > 30]
    # The hardest false claim: the best wrong time.
    false_claims += [elsewhere[0].lag_s] if elsewhere else []
    return {
        "present": present,
        "absent": absent,
        "true_claim": _claimed(found, true_claim, settings),
        "false_claims": [_claimed(found, float(c), settings) for c in false_claims],
    }


def _claimed(found: PhaseSearch, lag_s: float, settings: MatchSettings) -> float | None:
    raw, _ = weigh_claim(found, 0, lag_s, settings)
    return raw if np.isfinite(raw) else None


def _best(found: PhaseSearch, start_s: float, clock_ppm: float = math.nan) -> dict[str, Any] | None:
    """Return the best place and its errors; the start is NaN if the reference lacks it."""
    if not found.places:
        return None
    raw, place = weigh(found), found.places[0]
    clock = found.scorers[0].clock(place.lag_s)
    nominal_hz = found.scorers[0].grid.nominal_hz
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
