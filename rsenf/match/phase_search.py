"""Searches references for a clip by its phase.

The lags of a coarse search are scored (:mod:`rsenf.match.phase_scorer`) and the best peaks refined.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.match.clip_phase import ClipPhase
from rsenf.match.forecast import in_pages
from rsenf.match.phase_scorer import Clock, PhaseScorer
from rsenf.match.score import KEPT, Survey, survey
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

USUAL_PHASES = 600  # of a clip: for a longer one fewer lags are kept
QUICK_SHIFTS_S = (-0.5, 0.0, 0.5)
REFINED = 24  # places
HOPELESS = 100.0  # nats below the best peak: not refined any further
APART_S = 6.0  # nearer lags are one place
LEAST_STD_S = 0.01  # lower limit of a lag's standard error


@dataclass(frozen=True)
class Place:
    """A lag in one of the references, at the maximum of its peak; ``score`` in nats."""

    grid: int
    lag_s: float
    lag_std_s: float
    score: float

    @property
    def width_s(self) -> float:
        """Integral of the likelihood over the lag, divided by its maximum (Gaussian peak)."""
        return math.sqrt(2 * math.pi) * self.lag_std_s

    @property
    def weight(self) -> float:
        """Log of the likelihood integrated over the peak (nats) (Tierney and Kadane 1986)."""
        return self.score + math.log(self.width_s)


@dataclass(frozen=True, eq=False)
class PhaseSearch:
    """Result of a search.

    ``places`` are at least a neighbourhood apart, best first; ``surveys`` and ``scorers`` have one
    entry per reference; ``span_s`` is the size of the search.
    """

    places: list[Place]
    surveys: list[Survey]
    scorers: list[PhaseScorer]
    span_s: float

    @property
    def lags(self) -> int:
        """Number of lags compared."""
        return sum(s.lags for s in self.surveys)

    def clocks(self, places: Sequence[Place]) -> dict[Place, Clock]:
        """Estimate the clip's clock offset at each of some places."""
        out: dict[Place, Clock] = {}
        for number, scorer in enumerate(self.scorers):
            in_grid = [place for place in places if place.grid == number]
            if in_grid:
                found = scorer.clocks(np.array([place.lag_s for place in in_grid]))
                out |= zip(in_grid, found, strict=True)
        return out

    @property
    def coverage_ratio(self) -> float:
        """Share of the possible lags that could be compared."""
        possible = sum(s.possible for s in self.surveys)
        return sum(s.inside for s in self.surveys) / possible if possible else 1.0


def search_phase(
    track: Track, clip: ClipPhase, grids: Sequence[Grid], settings: MatchSettings
) -> PhaseSearch:
    """Search references for a clip; ``clip`` has the track's phases, without outliers.

    Raises
    ------
    UsageError
        If neither of the steps of track and reference is a whole multiple of the other.
    """
    kept = int(np.clip(KEPT * USUAL_PHASES / max(clip.size, 1), 32, KEPT))
    grids = [in_pages(grid) for grid in grids]
    surveys = [survey(track, grid, settings, kept) for grid in grids]
    scorers = [PhaseScorer(clip, grid, settings) for grid in grids]
    found: list[Place] = []
    for number, (scorer, seen) in enumerate(zip(scorers, surveys, strict=True)):
        found += _rough(number, scorer, seen.lag_s)
    found = distinct(found)
    best, rest = found[:REFINED], found[REFINED:]
    for number, scorer in enumerate(scorers):
        rest += all_refined(scorer, [place for place in best if place.grid == number])
    # The most probable place is the peak with the largest integral, not the highest.
    places = sorted(distinct(rest), key=lambda place: -place.weight)
    span_s = track.hypotheses * sum(s.lags * track.hop_s for s in surveys)
    return PhaseSearch(places, surveys, scorers, span_s)


def _rough(number: int, scorer: PhaseScorer, lag_s: FloatArray) -> list[Place]:
    """Score the lags of a coarse search and their neighbours, with few sizes of the errors."""
    if not lag_s.size:
        return []
    at = (lag_s[:, None] + np.array(QUICK_SHIFTS_S)).ravel()
    score = scorer.scores(at, quick=True).reshape(lag_s.size, -1)
    best = score.argmax(axis=1)
    return [
        Place(number, float(at[i * len(QUICK_SHIFTS_S) + b]), 0.5, float(score[i, b]))
        for i, b in enumerate(best)
        if np.isfinite(score[i, b])
    ]


def refined(scorer: PhaseScorer, place: Place) -> Place:
    """Refine a place to the maximum of its peak, in two passes."""
    return all_refined(scorer, [place])[0]


def all_refined(scorer: PhaseScorer, places: Sequence[Place]) -> list[Place]:
    """Refine several places of one reference; the second pass has the resolution of the peak."""
    if not places:
        return []
    lag_s = np.array([place.lag_s for place in places])
    std_s, height = np.full(len(places), 0.25), np.full(len(places), -np.inf)
    hopeful = np.arange(len(places))
    for spread in (np.arange(-4, 5), np.arange(-3, 4)):
        at = lag_s[hopeful, None] + std_s[hopeful, None] * spread
        score = scorer.scores(np.asarray(at.ravel(), np.float64)).reshape(at.shape)
        tops = [_top(*peak) for peak in zip(at, score, std_s[hopeful], strict=True)]
        lag_s[hopeful], std_s[hopeful], height[hopeful] = np.array(tops).T
        best_first = np.argsort(-height, kind="stable")
        reported = best_first[: scorer.settings.candidates]
        hopeful = np.union1d(reported, np.flatnonzero(height > height.max() - HOPELESS))
    return [
        Place(place.grid, float(lag), float(std), float(top))
        for place, lag, std, top in zip(places, lag_s, std_s, height, strict=True)
    ]


def _top(at: FloatArray, score: FloatArray, step_s: float) -> tuple[float, float, float]:
    """Return the position of a peak's maximum, its standard error, and its height."""
    top = int(np.clip(score.argmax(), 1, at.size - 2))
    before, here, after = score[top - 1 : top + 2]
    peaked = np.isfinite([before, here, after]).all() and before + after < 2 * here
    if not peaked:
        return at[top], 1.0, score.max()
    bend = 2 * here - before - after
    shift = float(np.clip((after - before) / (2 * bend), -1, 1))
    std_s = float(np.clip(step_s / math.sqrt(bend), LEAST_STD_S, 1.0))
    # Not the parabola's height: scores have steps where more phases fall into a gap.
    return at[top] + shift * step_s, std_s, score.max()


def distinct(places: list[Place]) -> list[Place]:
    """Sort places best first and drop every one too near to a better one."""
    out: list[Place] = []
    taken: dict[tuple[int, int], float] = {}  # lag in each stretch, which holds at most one
    for place in sorted(places, key=lambda p: -p.score):
        stretch = math.floor(place.lag_s / APART_S)
        near = ((place.grid, stretch + d) for d in (0, -1, 1))
        if all(abs(taken.get(at, math.inf) - place.lag_s) >= APART_S for at in near):
            taken[place.grid, stretch] = place.lag_s
            out.append(place)
    return out
