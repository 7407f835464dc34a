"""Find the lags at which a clip fits a reference, and how well the other lags do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.match.kernel import average, window_kernel
from rsenf.match.score import LagScorer, Peak
from rsenf.match.series import Grid, Track, phases, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

NEIGHBOURHOOD_RATIO = 1.5  # of the resolution: nearer lags belong to the same peak
MAX_TAIL = 64  # at most so many peaks describe the tail of wrong lags
SPARE = 4  # a broad peak can top several stretches: refine so many times the peaks wanted

WAYS = {"window": (True,), "none": (False,), "auto": (True, False)}


@dataclass(frozen=True, eq=False)
class Search:
    """Outcome of a search.

    ``peaks`` are at least a neighbourhood apart, the best first; of ``stretches`` neighbourhoods
    searched the best ``tail`` and two more have theirs among them. ``lags`` were compared. Of
    ``possible`` lags at which the clip lies within the reference's span, ``inside`` were.
    ``scorers`` compare at any lag under the averaging that fitted best (``smoothed``).
    """

    peaks: list[Peak]
    tail: int
    lags: int
    possible: int
    inside: int
    smoothed: bool
    smear_var_hz2: float
    scorers: list[LagScorer]

    @property
    def coverage_ratio(self) -> float:
        """Share of the possible lags that could be compared; 1 when there is none."""
        return self.inside / self.possible if self.possible else 1.0

    def near(self, lag_s: float, tolerance_s: float) -> Peak | None:
        """Return the best comparable lag within a tolerance of a given one, if there is one."""
        peaks = []
        for scorer in self.scorers:
            first = scorer.nearest_lag(lag_s - tolerance_s)
            last = scorer.nearest_lag(lag_s + tolerance_s)
            found = (scorer.peak(lag) for lag in range(first, last + 1))
            peaks += [p for p in found if p.seconds >= scorer.min_pairs * scorer.track.hop_s]
        return max(peaks, key=lambda p: p.score, default=None)


def search(track: Track, grid: Grid, settings: MatchSettings) -> Search:
    """Compare a track with a reference at every lag, under each way of averaging the reference.

    Returns
    -------
    Search
        Under the way that fits best.

    Raises
    ------
    UsageError
        When the steps of the two don't fit each other.
    """
    grid = to_step_of(track, grid)
    averaged = average(grid.freq_hz, window_kernel(track.window_s, grid.step_s))
    smear = grid.freq_hz - averaged
    smear_var = float(np.nanvar(smear)) if np.isfinite(smear).any() else 0.0
    found: list[Search] = []
    ordinary_hz2 = 0.0
    for smoothed in WAYS[settings.smoothing]:
        series = averaged if smoothed else grid.freq_hz
        usable_s = track.usable * track.hop_s
        scorers = [LagScorer(t, series, settings, usable_s) for t in phases(track, grid.step_s)]
        # One yardstick for both ways, or their scores could not be compared.
        ordinary_hz2 = ordinary_hz2 or scorers[0].sample_ordinary_var()
        for scorer in scorers:
            scorer.ordinary_var_hz2 = ordinary_hz2
        found.append(_search(scorers, smoothed, smear_var if smoothed else 0.0))
    return max(found, key=lambda s: s.peaks[0].score if s.peaks else -np.inf)


def _search(scorers: list[LagScorer], smoothed: bool, smear_var_hz2: float) -> Search:
    """Pass over all lags, keep the best of every stretch, refine the best of those."""
    apart_s = NEIGHBOURHOOD_RATIO * scorers[0].track.resolution_s
    lags = possible = inside = 0
    score, lag, owner = [], [], []
    for number, scorer in enumerate(scorers):
        last = scorer.y.size - scorer.x.size
        for table in scorer.tables():
            scores = scorer.scores(table.pairs, table.offset, table.residual_var)
            compared = np.isfinite(scores)
            within = (table.lags >= 0) & (table.lags <= last)
            lags += int(compared.sum())
            possible += int(within.sum())
            inside += int((within & compared).sum())
            best, where = _stretch_maxima(scores, max(round(apart_s / scorer.track.hop_s), 1))
            score.append(best)
            lag.append(table.first_lag + where)
            owner.append(np.full(best.size, number))
    all_score, all_lag, all_owner = (np.concatenate(v) for v in (score, lag, owner))
    tail = min(MAX_TAIL, int(np.sqrt(all_score.size / len(scorers))))
    order = np.argsort(-all_score, kind="stable")[: SPARE * (tail + 2) * len(scorers)]
    refined = [scorers[all_owner[i]].peak(int(all_lag[i])) for i in order]
    peaks = _distinct(refined, apart_s)[: tail + 2]
    return Search(peaks, tail, lags, possible, inside, smoothed, smear_var_hz2, scorers)


def _stretch_maxima(scores: FloatArray, length: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Find the best finite score of every stretch of lags that has one, and where it is."""
    padded = np.full(-(-scores.size // length) * length, -np.inf)
    padded[: scores.size] = np.where(np.isfinite(scores), scores, -np.inf)
    rows = padded.reshape(-1, length)
    where = rows.argmax(axis=1) + np.arange(rows.shape[0]) * length
    best = padded[where]
    found = np.isfinite(best)
    return best[found], where[found]


def _distinct(peaks: list[Peak], apart_s: float) -> list[Peak]:
    """Sort best first and drop every peak too near to a better one."""
    out: list[Peak] = []
    for peak in sorted(peaks, key=lambda p: -p.score):
        if all(abs(peak.lag_s - other.lag_s) >= apart_s for other in out):
            out.append(peak)
    return out
