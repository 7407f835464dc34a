"""The stretches of a clip that fit a reference by themselves: of an edited clip there are several.

A clip that was cut and rejoined, looped, or put together from several recordings fits nowhere as a
whole. Its pieces do, each at a lag of its own. Windows of the clip are searched for one by one; the
one that says most is followed both ways for as long as the clip agrees with its lag, and what is
left over is looked at in the same way, near what was found at first: most edits leave out or put in
seconds or minutes. Where no piece tells enough by itself, two that lie near each other may.
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

WINDOW_S = 50.0  # the shortest that are searched for
WINDOWS = 3  # of one stretch that are, at most
SHORT_S = 15.0  # the shortest beside a part that is known, and of those that are found in pairs
ROUNDS = 4  # of looking at what is left over
NEAR_S, NEAR_STEP_S = 600.0, 0.5  # of a part's lag, in which its neighbours' are looked for
NEAR_LOG10_LR = 1.0  # what a place so near needs, of a stretch that doesn't fit a known one
REFINED = 6  # places near a part, or pairs, that are
FOLLOWED = 3  # pairs
# What an edit moves the time by is as likely to be of one order of magnitude as of another.
LEAST_EDIT_S, MOST_EDIT_S = 0.1, 3600.0
LEAST = 10  # phases of a part
BESIDE = 10  # phases beside the ends of two parts, in which one turns into the other
ENDS = 48  # of a part that are tried at first
# Nats by which the place of a window must be likelier than none, the search counted, for it to be
# followed: with what lies beside it, it may tell enough.
LEAST_HOPE = -5.0
LN10 = math.log(10.0)

Span = tuple[int, int]  # phases of a clip, from the first up to the last
Ends = int | NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """A stretch of a clip and where it fits.

    ``place.lag_s`` is that of the clip's first frame, as for a whole clip. ``log10_lr`` weighs its
    time against none in the references, the choice of its ends and the search counted.
    """

    span: Span
    place: Place
    log10_lr: float


@dataclass(frozen=True)
class _Hope:
    """A window, where it may fit, and what it costs to have searched for that (nats)."""

    place: Place
    window: Span
    cost: float

    @property
    def odds(self) -> float:
        """Log odds of the place, the search counted."""
        return self.place.weight - self.cost


class Parts:
    """Looks for the parts of one clip in some references."""

    def __init__(
        self, track: Track, clip: ClipPhase, grids: Sequence[Grid], settings: MatchSettings
    ) -> None:
        self.track, self.clip, self.grids, self.settings = track, clip, grids, settings
        # Short spans count as well: whether they tell enough is for their evidence to say.
        self._any_length = replace(settings, min_overlap=1e-6)
        self._scorers = [PhaseScorer(clip, grid, self._any_length, robust=False) for grid in grids]
        self._searched = math.log(max(sum(grid.duration_s for grid in grids), 1.0))

    def found(self, best: Place, claimed: Sequence[Place] = ()) -> list[Part]:
        """Find the parts, in the clip's order.

        Parameters
        ----------
        best : Place
            Where the whole clip fits best; it is tried before anything else is searched for.
        claimed : sequence of Place, optional
            Where it is said to be, which nobody had to search for.
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
        """Log-likelihood over any grid's of some spans together at one lag (nats)."""
        index = np.arange(self.clip.size)[:, None]
        among = np.any([(index > first) & (index < last) for first, last in spans], axis=0)
        return float(self._scorers[place.grid].scores(np.array([place.lag_s]), among)[0])

    def meeting(self, a: Part, b: Part) -> tuple[float, float]:
        """Where in the clip one part ends and the next begins, and its standard error (s).

        The phase that comes first after it is as likely anywhere in a turn.
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

    def _tried(self, places: Sequence[Place], stretch: Span, cost: float) -> list[Part]:
        """Follow known places through a stretch."""
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

    def _near(self, known: Sequence[Place], stretch: Span) -> list[Part]:
        """Search for the windows of a stretch about known places."""
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
                        place, lag_s=float(place.lag_s + away), lag_std_s=0.25, score=float(own)
                    )
                    for away, own in zip(away_s, scores - cost, strict=True)
                ]
                for one in distinct(rough)[:REFINED]:
                    top = self._at_top(one, window)
                    own = float(edit_cost(np.array(top.lag_s - place.lag_s))) + choice
                    found.append(_Hope(top, window, own))
        return self._followed(found, stretch, NEAR_LOG10_LR)

    def _search(self, stretch: Span) -> list[Part]:
        """Search for the windows of a stretch, and follow what is found."""
        found = [
            _Hope(place, window, self._searched)
            for window in self._windows(stretch, WINDOW_S, WINDOWS)
            for place in self._places(window)[:1]
        ]
        return self._followed(found, stretch)

    def _pieced(self, whole: Span) -> list[Part]:
        """Search for shorter windows: one by one, and for two that tell enough together."""
        places = {window: self._places(window) for window in self._windows(whole, SHORT_S, WINDOWS)}
        alone = [
            _Hope(place, window, self._searched)
            for window, own in places.items()
            for place in own[:1]
        ]
        return self._followed(alone, whole) or self._pair(places, whole)

    def _pair(self, places: Mapping[Span, list[Place]], whole: Span) -> list[Part]:
        """Find two stretches that tell enough together: an edit lies between their times."""
        hopes = []
        for (first, one), (second, other) in combinations(places.items(), 2):
            weight, lag_s, grid = (
                [np.array([getattr(place, name) for place in own]) for own in (one, other)]
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
    ) -> tuple[Part, Part]:
        """Follow two places from their windows, and weigh them together."""
        one, first, _ = self._grown_from(one, first, (whole[0], second[0]))
        other, second, _ = self._grown_from(other, second, (first[1], whole[1]))
        # Of two that meet, one end follows from the other.
        inner = [first[0] > whole[0], True, second[0] - first[1] > LEAST, second[1] < whole[1]]
        chosen = sum(inner) * math.log(self.clip.size)
        together = _together(one, other)
        log10_lr = calibration().absent((together - self._searched - chosen) / LN10)
        # Neither is to be carried by the other.
        weaker = together - max(one.weight, other.weight)
        if calibration().absent(weaker / LN10) < NEAR_LOG10_LR:
            log10_lr = -math.inf
        return Part(first, one, log10_lr), Part(second, other, log10_lr)

    def _places(self, window: Span) -> list[Place]:
        """Search the references for a window."""
        clip = self.clip.between(*window)
        settings = replace(self.settings, min_seconds=0.5 * SHORT_S)
        return search_phase(self._track_of(window), clip, self.grids, settings).places

    def _window_scorer(self, window: Span, grid: int) -> PhaseScorer:
        clip = self.clip.between(*window)
        return PhaseScorer(clip, self.grids[grid], self._any_length, robust=False)

    def _at_top(self, place: Place, window: Span) -> Place:
        return refined(self._window_scorer(window, place.grid), place)

    def _windows(self, stretch: Span, shortest_s: float, most: int | None = None) -> list[Span]:
        """Divide a stretch into equal windows; none where it is too short to tell anything."""
        first, last = stretch
        if (last - first) * self.clip.hop_s < min(shortest_s, self.settings.min_seconds):
            return []
        length_s = self.clip.t_s[last - 1] - self.clip.t_s[first] + self.clip.hop_s
        count = int(np.clip(length_s / shortest_s, 1, most))
        return list(pairwise(int(end) for end in np.linspace(first, last, count + 1)))

    def _track_of(self, window: Span) -> Track:
        """Leave only the estimates of a window."""
        t_s = self.clip.t_s[[window[0], window[1] - 1]] - self.track.first_s
        first, last = np.rint(t_s / self.track.hop_s).astype(int)
        return self.track.between(int(first), int(last) + 1)

    def _followed(
        self, found: Sequence[_Hope], stretch: Span, least: float | None = None
    ) -> list[Part]:
        """Follow places from their windows, what says most first, as far as there is room."""
        least = self.settings.min_log10_lr if least is None else least
        out: list[Part] = []
        for hope in sorted(found, key=lambda hope: -hope.odds):
            if hope.odds < LEAST_HOPE:
                break
            first, last = hope.window
            for free in between(out, stretch):
                window = max(first, free[0]), min(last, free[1])
                if window[1] - window[0] >= LEAST:
                    out += self._follow(hope.place, window, free, hope.cost, least)
                    out.sort(key=lambda part: part.span)
        return out

    def _follow(
        self, place: Place, window: Span, stretch: Span, cost: float, least: float
    ) -> tuple[Part] | tuple[()]:
        """Follow a lag from a window both ways; nothing where what fits tells too little."""
        place, span, chosen = self._grown_from(place, window, stretch)
        log10_lr = calibration().absent((place.weight - cost - chosen) / LN10)
        return (Part(span, place, log10_lr),) if log10_lr >= least else ()

    def _grown_from(self, place: Place, span: Span, stretch: Span) -> tuple[Place, Span, float]:
        """Follow a lag from a window both ways.

        Returns the place, the span, and what its choice costs (nats): that of all the ends that it
        might have had, but for those of the stretch.
        """
        for quick in (True, False):
            span = self._grown(place, span, stretch, quick=quick)
            place = self._at_top(place, span)
        place = replace(place, score=place.score + self._by_runs(place, span))
        inner = (span[0] > stretch[0]) + (span[1] < stretch[1])
        return place, span, inner * math.log(stretch[1] - stretch[0])

    def _by_runs(self, place: Place, span: Span) -> float:
        """What a score changes by where the reference has gaps, if any grid may start anew there.

        At a lag with a gap just where the clip was cut the jump counts for nothing. It mustn't
        count against any other grid either.
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
        """Move the ends of a span to where the clip agrees with a lag the longest."""
        first = span[0]
        ends = np.arange(min(first + LEAST, stretch[1]), stretch[1] + 1)
        last = _best(ends, lambda end: self._span_scores(place, first, end, quick=quick))
        ends = np.arange(stretch[0], max(last - LEAST, stretch[0]) + 1)
        return _best(ends, lambda end: self._span_scores(place, end, last, quick=quick)), last

    def _span_scores(
        self, place: Place, firsts: Ends, lasts: Ends, *, quick: bool = False
    ) -> FloatArray:
        """Score spans of phases, of either end one or many, at a place."""
        firsts, lasts = np.broadcast_arrays(np.atleast_1d(firsts), np.atleast_1d(lasts))
        index = np.arange(self.clip.size)[:, None]
        among = (index > firsts) & (index < lasts)
        lag_s = np.full(firsts.size, place.lag_s)
        return self._scorers[place.grid].scores(lag_s, among, quick=quick)


def edit_cost(away_s: FloatArray) -> FloatArray:
    """What it costs to look for a neighbour's lag at some distance from a known one (nats)."""
    size_s = np.maximum(np.abs(away_s), LEAST_EDIT_S)
    return np.asarray(np.log(2.0 * math.log(MOST_EDIT_S / LEAST_EDIT_S) * size_s), np.float64)


def _together(one: Place, other: Place) -> float:
    """Weight of two places, that of the edit between them counted."""
    return one.weight + other.weight - float(edit_cost(np.array(one.lag_s - other.lag_s)))


def between(parts: Sequence[Part], stretch: Span) -> list[Span]:
    """What parts, in order, leave of a stretch."""
    firsts = [stretch[0], *(part.span[1] for part in parts)]
    lasts = [*(part.span[0] for part in parts), stretch[1]]
    return [(a, b) for a, b in zip(firsts, lasts, strict=True) if b > a]


def _best(ends: NDArray[np.int64], score: Callable[[NDArray[np.int64]], FloatArray]) -> int:
    """Find the end with the best score: of some of them at first, then of those about the best."""
    step = max(ends.size // ENDS, 1)
    near = int(score(ends[::step]).argmax()) * step
    fine = ends[max(near - step, 0) : near + step + 1]
    return int(fine[int(score(fine).argmax())])
