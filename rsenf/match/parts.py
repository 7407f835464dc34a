"""The stretches of a clip that fit a reference by themselves: of an edited clip there are several.

A clip that was cut and rejoined, looped, or put together from several recordings fits nowhere as a
whole. Its pieces do, each at a lag of its own. Windows of the clip are searched for one by one; the
one that says most is followed both ways for as long as the clip agrees with its lag, and what is
left over is looked at in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rsenf.match.calibration import calibration
from rsenf.match.clip_phase import ClipPhase
from rsenf.match.phase_search import PhaseScorer, Place, refined, search_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

WINDOW_S = 50.0  # the shortest that are searched for
WINDOWS = 3  # of one stretch that are, at most
ROUNDS = 2  # of looking at what is left over
LEAST = 10  # phases of a part
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
                more += self._tried(known, free, 0.0) or self._search(free)
            if not more:
                break
            out = sorted(out + more, key=lambda part: part.span)
        return out

    def score(self, place: Place, *spans: Span) -> float:
        """Log-likelihood over any grid's of some spans together at one lag (nats)."""
        index = np.arange(self.clip.size)[:, None]
        among = np.any([(index > first) & (index < last) for first, last in spans], axis=0)
        return float(self._scorers[place.grid].scores(np.array([place.lag_s]), among)[0])

    def _tried(self, places: Sequence[Place], stretch: Span, searched: float) -> list[Part]:
        """Follow known places through a stretch."""
        windows = self._windows(stretch, self.settings.min_seconds)
        if not windows:
            return []
        found = []
        for place in places:
            scores = self._span_scores(place, *np.array(windows).T)
            found += [
                (replace(place, score=float(score)), window)
                for score, window in zip(scores, windows, strict=True)
            ]
        return self._followed(found, stretch, searched)

    def _search(self, stretch: Span) -> list[Part]:
        """Search for the windows of a stretch, and follow what is found."""
        found = []
        for window in self._windows(stretch, WINDOW_S, WINDOWS):
            places = search_phase(
                self._track_of(window), self.clip.between(*window), self.grids, self.settings
            ).places
            found += [(place, window) for place in places[:1]]
        return self._followed(found, stretch, self._searched)

    def _windows(self, stretch: Span, shortest_s: float, most: int | None = None) -> list[Span]:
        """Divide a stretch into equal windows; none where it is too short to tell anything."""
        first, last = stretch
        if (last - first) * self.clip.hop_s < self.settings.min_seconds:
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
        self, found: Sequence[tuple[Place, Span]], stretch: Span, searched: float
    ) -> list[Part]:
        """Follow places from their windows, what says most first, as far as there is room."""
        out: list[Part] = []
        for place, (first, last) in sorted(found, key=lambda pw: -pw[0].weight):
            if place.weight - searched < LEAST_HOPE:
                break
            for free in between(out, stretch):
                window = max(first, free[0]), min(last, free[1])
                if window[1] - window[0] > LEAST:
                    out += self._follow(place, window, free, searched)
                    out.sort(key=lambda part: part.span)
        return out

    def _follow(
        self, place: Place, window: Span, stretch: Span, searched: float
    ) -> tuple[Part] | tuple[()]:
        """Follow a lag from a window both ways; nothing where what fits tells too little."""
        span = window
        for quick in (True, False):
            span = self._grown(place, span, stretch, quick=quick)
            own = PhaseScorer(
                self.clip.between(*span), self.grids[place.grid], self._any_length, robust=False
            )
            place = refined(own, place)
        # Of all the ends that it might have had, but for those of the stretch.
        inner = (span[0] > stretch[0]) + (span[1] < stretch[1])
        chosen = inner * math.log(stretch[1] - stretch[0])
        log10_lr = calibration().absent((place.weight - searched - chosen) / LN10)
        enough = log10_lr >= self.settings.min_log10_lr
        return (Part(span, place, log10_lr),) if enough else ()

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
