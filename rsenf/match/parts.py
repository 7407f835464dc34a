"""Finds the parts of an edited clip, each of which fits a reference at a lag of its own.

Model: a part follows the reference at one lag (:mod:`rsenf.match.phase_filter`); between parts the
lag jumps by an edit's size, log-uniform from 0.1 s to 1 h.
Statistic: the log-likelihood ratio of :mod:`rsenf.match.phase_scorer` over a span, less the log of
the number of alternatives searched (lags, ends, size of the edit).
Approximate: the ends of a span are fitted, so the penalty is approximate. The search is greedy: the
best of some windows is extended as long as the clip agrees, then the free stretches are searched,
first near the lags found. If no window is enough evidence on its own, pairs are tried.

References
----------
Rodríguez, D. P. N., Apolinário, J. A. and Biscainho, L. W. P. (2010), Audio authenticity: detecting
ENF discontinuity with high precision phase analysis, IEEE TIFS 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from rsenf.match.calibration import calibration
from rsenf.match.clip_phase import ClipPhase
from rsenf.match.forecast import forecast
from rsenf.match.ou_likelihood import generic_log_likelihood
from rsenf.match.phase_scorer import PhaseScorer
from rsenf.match.phase_search import Place, distinct, refined, search_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

WINDOW_S = 50.0  # shortest window of a full search
WINDOWS = 3  # most windows of one stretch
SHORT_S = 15.0  # shortest window near a known part, and of a pair
ROUNDS = 4  # of searching the free stretches
NEAR_S, NEAR_STEP_S = 600.0, 0.5  # range and step of the search about a known part's lag
NEAR_LOG10_LR = 1.0  # least evidence for a place found near a known one
REFINED = 6  # places near a part, or pairs, that are refined
FOLLOWED = 3  # pairs that are extended
# The prior of an edit's size is log-uniform between these.
LEAST_EDIT_S, MOST_EDIT_S = 0.1, 3600.0
MIN_PHASES = 10  # phases of a part
BESIDE = 10  # phases on either side of two parts' ends that may be the boundary
ENDS = 48  # positions of an end on the coarse grid
# Least log odds (nats, with the penalty) of a window's place to be extended: together with the
# phases next to it, it may be enough evidence.
LEAST_HOPE = -5.0
LN10 = math.log(10.0)

Span = tuple[int, int]  # phases of a clip: the first, and the one after the last
Ends = int | NDArray[np.int64]


@dataclass(frozen=True)
class ClipPart:
    """A part of a clip and where it fits.

    ``place.lag_s`` is the lag of the clip's first frame, as for a whole clip. ``log10_lr`` is the
    likelihood ratio of its time against a time in none of the references, with penalties for the
    search and for the choice of its ends.
    """

    span: Span
    place: Place
    log10_lr: float


@dataclass(frozen=True)
class _Hope:
    """A candidate: a window, the place where it may fit, and the penalty for the search (nats)."""

    place: Place
    window: Span
    cost: float

    @property
    def odds(self) -> float:
        """Log odds of the place, including the penalty."""
        return self.place.weight - self.cost


class Parts:
    """Finds the parts of one clip in some references.

    Parameters
    ----------
    track : Track
    clip : ClipPhase
        The track's phases.
    grids : sequence of Grid
    settings : MatchSettings
    """

    def __init__(
        self, track: Track, clip: ClipPhase, grids: Sequence[Grid], settings: MatchSettings
    ) -> None:
        self.track, self.clip, self.grids, self.settings = track, clip, grids, settings
        # No minimum length: the likelihood ratio decides whether a short span is enough evidence.
        self._any_length = replace(settings, min_overlap=1e-6)
        self._scorers = [PhaseScorer(clip, grid, self._any_length, robust=False) for grid in grids]
        self._searched = math.log(max(sum(grid.duration_s for grid in grids), 1.0))

    def found(self, best: Place, claimed: Sequence[Place] = ()) -> list[ClipPart]:
        """Find the parts, in the clip's order (Rodríguez et al. 2010).

        Parameters
        ----------
        best : Place
            Where the whole clip fits best; tried before anything is searched for.
        claimed : sequence of Place, optional
            Claimed places, tried first and without a penalty for a search.
        """
        whole = 0, self.clip.size
        out = self._tried(claimed, whole, 0.0) or self._tried([best], whole, self._searched)
        for _ in range(ROUNDS):
            known = [part.place for part in out]
            more = []
            for free in between(out, whole):
                more += self._tried(known, free, 0.0) or self._near(known, free)
                more += [] if more else self._search(free)
            if not (more := more or ([] if out else self._pieced(whole))):
                break
            out = sorted(out + more, key=lambda part: part.span)
        return out

    def score(self, place: Place, *spans: Span) -> float:
        """Return the log-likelihood ratio of spans together at one lag, against any grid (nats).

        Parameters
        ----------
        place : Place
        *spans : tuple of (int, int)
            Phases: the first, and the one after the last.
        """
        index = np.arange(self.clip.size)[:, None]
        among = np.any([(index > first) & (index < last) for first, last in spans], axis=0)
        return float(self._scorers[place.grid].scores(np.array([place.lag_s]), among)[0])

    def meeting(self, a: ClipPart, b: ClipPart) -> tuple[float, float]:
        """Return the boundary between two parts and its standard error, in seconds of the clip.

        Posterior mean over the possible boundaries, where the first phase after the boundary is
        uniform over a turn. If the gap between the parts is long, its middle.
        """
        gap = slice(a.span[1] - 1, b.span[0] + 1)
        first, last = max(a.span[1] - BESIDE, a.span[0] + 2), min(b.span[0] + BESIDE, b.span[1] - 1)
        gap_s = float(self.clip.t_s[b.span[0]] - self.clip.t_s[a.span[1] - 1])
        if gap_s > BESIDE * self.clip.hop_s or first >= last:
            return float(self.clip.t_s[gap].mean()), gap_s / math.sqrt(12.0)
        ends = np.arange(first, last)
        generic = self._scorers[a.place.grid].readings[0].generic[ends]
        score = self._span_scores(a.place, a.span[0], ends) - generic
        score += self._span_scores(b.place, ends, b.span[1])
        weight = np.exp(score - np.logaddexp.reduce(score))
        way_s = self.clip.t_s[ends] - self.clip.t_s[ends - 1]
        at_s = self.clip.t_s[ends] - way_s / 2
        mean_s = float(weight @ at_s)
        return mean_s, math.sqrt(float(weight @ ((at_s - mean_s) ** 2 + way_s**2 / 12.0)))

    def _tried(self, places: Sequence[Place], stretch: Span, cost: float) -> list[ClipPart]:
        """Extend known places through a stretch."""
        windows = self._windows(stretch, self.settings.min_seconds)
        if not windows:
            return []
        found = []
        for place in places:
            scores = self._span_scores(place, *np.array(windows).T)
            found += [
                _Hope(replace(place, score=float(score)), window, cost)
                for score, window in zip(scores, windows, strict=True)
            ]
        return self._followed(found, stretch)

    def _near(self, known: Sequence[Place], stretch: Span) -> list[ClipPart]:
        """Search for the windows of a stretch near known places."""
        steps = round(NEAR_S / NEAR_STEP_S)
        away_s = np.linspace(-NEAR_S, NEAR_S, 2 * steps + 1)
        cost, choice = edit_cost(away_s), math.log(max(len(known), 1))
        found = []
        for window in self._windows(stretch, SHORT_S, WINDOWS) if known else ():
            for place in known:
                scores = self._window_scorer(window, place.grid).scores(
                    place.lag_s + away_s, quick=True
                )
                rough = [
                    replace(
                        place, lag_s=float(place.lag_s + away), lag_std_s=0.25, score=float(score)
                    )
                    for away, score in zip(away_s, scores - cost, strict=True)
                ]
                for one in distinct(rough)[:REFINED]:
                    top = self._at_top(one, window)
                    penalty = float(edit_cost(np.array(top.lag_s - place.lag_s))) + choice
                    found.append(_Hope(top, window, penalty))
        return self._followed(found, stretch, NEAR_LOG10_LR)

    def _search(self, stretch: Span) -> list[ClipPart]:
        """Search all references for the windows of a stretch, and extend what is found."""
        found = [
            _Hope(place, window, self._searched)
            for window in self._windows(stretch, WINDOW_S, WINDOWS)
            for place in self._places(window)[:1]
        ]
        return self._followed(found, stretch)

    def _pieced(self, whole: Span) -> list[ClipPart]:
        """Search for shorter windows, singly and in pairs that are enough evidence together."""
        places = {window: self._places(window) for window in self._windows(whole, SHORT_S, WINDOWS)}
        alone = [
            _Hope(place, window, self._searched)
            for window, ranked in places.items()
            for place in ranked[:1]
        ]
        return self._followed(alone, whole) or self._pair(places, whole)

    def _pair(self, places: Mapping[Span, list[Place]], whole: Span) -> list[ClipPart]:
        """Find two stretches that are enough evidence together, with an edit between them."""
        hopes = []
        for (first, one), (second, other) in combinations(places.items(), 2):
            weight, lag_s, grid = (
                [np.array([getattr(place, name) for place in group]) for group in (one, other)]
                for name in ("weight", "lag_s", "grid")
            )
            both = np.add.outer(*weight) - edit_cost(np.subtract.outer(*lag_s))
            both[np.not_equal.outer(*grid)] = -np.inf
            for at in np.argsort(-both, axis=None)[:REFINED]:
                a, b = np.unravel_index(at, both.shape)
                tops = self._at_top(one[a], first), self._at_top(other[b], second)
                odds = _together(*tops) - self._searched
                if odds >= LEAST_HOPE:
                    hopes.append((odds, tops[0], first, tops[1], second))
        hopes.sort(key=lambda hope: -hope[0])
        found = [self._joined(*hope[1:], whole) for hope in hopes[:FOLLOWED]]
        best = max(found, key=lambda pair: pair[0].log10_lr, default=())
        return list(best) if best and best[0].log10_lr >= self.settings.min_log10_lr else []

    def _joined(
        self, one: Place, first: Span, other: Place, second: Span, whole: Span
    ) -> tuple[ClipPart, ClipPart]:
        """Extend two places from their windows, and weigh them together."""
        one, first, _ = self._grown_from(one, first, (whole[0], second[0]))
        other, second, _ = self._grown_from(other, second, (first[1], whole[1]))
        # If the two parts meet, their common boundary is one choice, not two.
        inner = [first[0] > whole[0], True, second[0] - first[1] > MIN_PHASES, second[1] < whole[1]]
        chosen = sum(inner) * math.log(self.clip.size)
        together = _together(one, other)
        log10_lr = calibration().absent((together - self._searched - chosen) / LN10)
        # Each part needs evidence of its own, apart from the other.
        weaker = together - max(one.weight, other.weight)
        if calibration().absent(weaker / LN10) < NEAR_LOG10_LR:
            log10_lr = -math.inf
        return ClipPart(first, one, log10_lr), ClipPart(second, other, log10_lr)

    def _places(self, window: Span) -> list[Place]:
        """Search the references for a window."""
        clip = self.clip.between(*window)
        first, last = np.rint((clip.t_s[[0, -1]] - self.track.first_s) / self.track.hop_s)
        track = self.track.between(int(first), int(last) + 1)
        settings = replace(self.settings, min_seconds=0.5 * SHORT_S)
        return search_phase(track, clip, self.grids, settings).places

    def _window_scorer(self, window: Span, grid: int) -> PhaseScorer:
        clip = self.clip.between(*window)
        return PhaseScorer(clip, self.grids[grid], self._any_length, robust=False)

    def _at_top(self, place: Place, window: Span) -> Place:
        return refined(self._window_scorer(window, place.grid), place)

    def _windows(self, stretch: Span, shortest_s: float, most: int | None = None) -> list[Span]:
        """Divide a stretch into equal windows; none if it is too short."""
        first, last = stretch
        if (last - first) * self.clip.hop_s < min(shortest_s, self.settings.min_seconds):
            return []
        length_s = self.clip.t_s[last - 1] - self.clip.t_s[first] + self.clip.hop_s
        count = int(np.clip(length_s / shortest_s, 1, most))
        return list(pairwise(int(end) for end in np.linspace(first, last, count + 1)))

    def _followed(
        self, found: Sequence[_Hope], stretch: Span, least: float | None = None
    ) -> list[ClipPart]:
        """Extend candidates from their windows, the best first, within the free stretches."""
        least = self.settings.min_log10_lr if least is None else least
        out: list[ClipPart] = []
        for hope in sorted(found, key=lambda hope: -hope.odds):
            if hope.odds < LEAST_HOPE:
                break
            first, last = hope.window
            for free in between(out, stretch):
                window = max(first, free[0]), min(last, free[1])
                if window[1] - window[0] >= MIN_PHASES:
                    out += self._follow(hope.place, window, free, hope.cost, least)
                    out.sort(key=lambda part: part.span)
        return out

    def _follow(
        self, place: Place, window: Span, stretch: Span, cost: float, least: float
    ) -> tuple[ClipPart] | tuple[()]:
        """Extend a lag from a window in both directions; empty if the evidence is too small."""
        place, span, chosen = self._grown_from(place, window, stretch)
        log10_lr = calibration().absent((place.weight - cost - chosen) / LN10)
        return (ClipPart(span, place, log10_lr),) if log10_lr >= least else ()

    def _grown_from(self, place: Place, span: Span, stretch: Span) -> tuple[Place, Span, float]:
        """Extend a lag from a window in both directions.

        Returns the place, the span, and the penalty for choosing its ends (nats): the log of the
        number of possible ends, except for ends that are those of the stretch.
        """
        for quick in (True, False):
            span = self._grown(place, span, stretch, quick=quick)
            place = self._at_top(place, span)
        place = replace(place, score=place.score + self._by_runs(place, span))
        inner = (span[0] > stretch[0]) + (span[1] < stretch[1])
        return place, span, inner * math.log(stretch[1] - stretch[0])

    def _by_runs(self, place: Place, span: Span) -> float:
        """Correction of a score for gaps of the reference: any grid may jump there too.

        At a lag with a gap just where the clip was cut, the jump costs the reference nothing. So it
        must not count against the alternative (any grid) either.
        """
        clip = self.clip.between(*span)
        grid = self.grids[place.grid]
        known = forecast(grid, np.array([place.lag_s]), clip.t_s)[1][:, 0]
        if known[1:].all():
            return 0.0
        whole = generic_log_likelihood(clip)
        ends = [*np.flatnonzero(~known).tolist(), clip.size]
        runs = [generic_log_likelihood(clip.between(a, b)).sum() for a, b in pairwise(ends)]
        return float(whole[known].sum() - sum(runs))

    def _grown(self, place: Place, span: Span, stretch: Span, *, quick: bool) -> Span:
        """Move the ends of a span to the maximum of its score at a lag."""
        first = span[0]
        ends = np.arange(min(first + MIN_PHASES, stretch[1]), stretch[1] + 1)
        last = _best(ends, lambda end: self._span_scores(place, first, end, quick=quick))
        ends = np.arange(stretch[0], max(last - MIN_PHASES, stretch[0]) + 1)
        return _best(ends, lambda end: self._span_scores(place, end, last, quick=quick)), last

    def _span_scores(
        self, place: Place, firsts: Ends, lasts: Ends, *, quick: bool = False
    ) -> FloatArray:
        """Score spans of phases at a place; either end may be one or many."""
        firsts, lasts = np.broadcast_arrays(np.atleast_1d(firsts), np.atleast_1d(lasts))
        index = np.arange(self.clip.size)[:, None]
        among = (index > firsts) & (index < lasts)
        lag_s = np.full(firsts.size, place.lag_s)
        return self._scorers[place.grid].scores(lag_s, among, quick=quick)


def edit_cost(away_s: FloatArray) -> FloatArray:
    """Penalty (nats) for a neighbour's lag ``away_s`` from a known one.

    The negative log density of an edit of that size, log-uniform from 0.1 s to 1 h in either
    direction.
    """
    size_s = np.maximum(np.abs(away_s), LEAST_EDIT_S)
    return np.asarray(np.log(2.0 * math.log(MOST_EDIT_S / LEAST_EDIT_S) * size_s), np.float64)


def _together(one: Place, other: Place) -> float:
    """Log weight of two places, less the penalty for the edit between them."""
    return one.weight + other.weight - float(edit_cost(np.array(one.lag_s - other.lag_s)))


def between(parts: Sequence[ClipPart], stretch: Span) -> list[Span]:
    """Return the stretches that parts, in order, leave free."""
    firsts = [stretch[0], *(part.span[1] for part in parts)]
    lasts = [*(part.span[0] for part in parts), stretch[1]]
    return [(a, b) for a, b in zip(firsts, lasts, strict=True) if b > a]


def _best(ends: NDArray[np.int64], score: Callable[[NDArray[np.int64]], FloatArray]) -> int:
    """Find the end with the best score, on a coarse grid first and then around its maximum."""
    step = max(ends.size // ENDS, 1)
    near = int(score(ends[::step]).argmax()) * step
    fine = ends[max(near - step, 0) : near + step + 1]
    return int(fine[int(score(fine).argmax())])
