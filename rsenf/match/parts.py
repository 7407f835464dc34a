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

WINDOW_S = 50.0  # a stretch is divided into windows of this at least
WINDOWS = 3  # of one stretch, at most
ROUNDS = 2  # of looking at what is left over
FOLLOWED = 2  # times that a part's lag and its ends are found from each other
LEAST = 10  # phases of a part
ENDS = 64  # of a part that are tried at first
LN10 = math.log(10.0)

Span = tuple[int, int]  # phases of a clip, from the first up to the last


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
        self._scorers = [PhaseScorer(clip, grid, self._any_length) for grid in grids]
        self._searched = math.log(max(sum(grid.duration_s for grid in grids), 1.0))

    def found(self, best: Place) -> list[Part]:
        """Find the parts, in the clip's order.

        Parameters
        ----------
        best : Place
            Where the whole clip fits best; it is tried before anything else is searched for.
        """
        whole = 0, self.clip.size
        out = self._tried([best], whole, self._searched)
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
        tried = [(p, window) for p in places for window in self._windows(stretch)]
        tried.sort(key=lambda pw: -self.score(*pw))
        return self._followed(tried, stretch, searched)

    def _search(self, stretch: Span) -> list[Part]:
        """Search for the windows of a stretch, and follow what is found, what says most first."""
        found = []
        for window in self._windows(stretch):
            places = search_phase(
                self._track_of(window), self.clip.between(*window), self.grids, self.settings
            ).places
            found += [(place, window) for place in places[:1]]
        found.sort(key=lambda pw: -pw[0].weight)
        return self._followed(found, stretch, self._searched)

    def _windows(self, stretch: Span) -> list[Span]:
        """Divide a stretch into equal windows; none where it is too short."""
        first, last = stretch
        if (last - first) * self.clip.hop_s < self.settings.min_seconds:
            return []
        length_s = self.clip.t_s[last - 1] - self.clip.t_s[first] + self.clip.hop_s
        count = int(np.clip(length_s / WINDOW_S, 1, WINDOWS))
        return list(pairwise(int(end) for end in np.linspace(first, last, count + 1)))

    def _track_of(self, window: Span) -> Track:
        """Leave only the estimates of a window."""
        t_s = self.clip.t_s[[window[0], window[1] - 1]] - self.track.first_s
        first, last = np.rint(t_s / self.track.hop_s).astype(int)
        return self.track.between(int(first), int(last) + 1)

    def _followed(
        self, found: Sequence[tuple[Place, Span]], stretch: Span, searched: float
    ) -> list[Part]:
        """Follow places from their windows, each as far as those before have left room."""
        out: list[Part] = []
        for place, (first, last) in found:
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
        first, last = window
        for _ in range(FOLLOWED):
            last = _best(
                min(first + LEAST, stretch[1]), stretch[1], self._by_end(place, first=first)
            )
            first = _best(stretch[0], max(last - LEAST, stretch[0]), self._by_end(place, last=last))
            own = self.clip.between(first, last)
            grid = self.grids[place.grid]
            scorer = PhaseScorer(own, grid, self._any_length)
            place = refined(scorer, place)
        ends = 2.0 * math.log(stretch[1] - stretch[0])
        log10_lr = calibration().absent((place.weight - searched - ends) / LN10)
        enough = log10_lr >= self.settings.min_log10_lr
        return (Part((first, last), place, log10_lr),) if enough else ()

    def _by_end(
        self, place: Place, *, first: int | None = None, last: int | None = None
    ) -> Callable[[NDArray[np.int64]], FloatArray]:
        """Return the score of spans of which one end is given, by the other."""

        def scores(end: NDArray[np.int64]) -> FloatArray:
            index = np.arange(self.clip.size)[:, None]
            among = index > (end if first is None else first)
            among = among & (index < (end if last is None else last))
            return self._scorers[place.grid].scores(np.full(end.size, place.lag_s), among)

        return scores


def between(parts: Sequence[Part], stretch: Span) -> list[Span]:
    """What parts, in order, leave of a stretch."""
    firsts = [stretch[0], *(part.span[1] for part in parts)]
    lasts = [*(part.span[0] for part in parts), stretch[1]]
    return [(a, b) for a, b in zip(firsts, lasts, strict=True) if b > a]


def _best(low: int, high: int, score: Callable[[NDArray[np.int64]], FloatArray]) -> int:
    """Whole number from ``low`` to ``high`` with the best score: by large steps, then by one."""
    step = max((high - low) // ENDS, 1)
    rough = np.arange(low, high + step, step).clip(max=high)
    near = int(rough[int(score(rough).argmax())])
    fine = np.arange(max(near - step, low), min(near + step, high) + 1)
    return int(fine[int(score(fine).argmax())])
