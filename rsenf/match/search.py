"""Finds the lags at which a clip's frequency fits a reference, and how well other lags fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rsenf.match.coarse import stretch_maxima
from rsenf.match.kernel import average, box_kernel, window_kernel
from rsenf.match.score import LagScorer, Peak
from rsenf.match.series import Grid, Track, phases, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

NEIGHBOURHOOD_RATIO = 1.5  # of the resolution: nearer lags belong to the same peak
USUAL_WINDOW_S = 20.0  # of references that are averages
MIN_AVERAGED = 0.8  # share of an average's weights that must fall on valid estimates
MAX_TAIL = 64  # most peaks that describe the tail of wrong lags
SPARE = 4  # factor on the peaks to refine: a broad peak can be the best of several stretches


@dataclass(frozen=True, eq=False)
class Way:
    """One way to make a clip and a reference comparable: which of them is averaged.

    ``text`` says what was done to the reference. ``smear_var_hz2`` is the part of the estimates'
    variance that is due to their window and removed by averaging the reference likewise.
    """

    track: Track
    grid: Grid
    text: str
    smear_var_hz2: float = 0.0


@dataclass(frozen=True, eq=False)
class Search:
    """Result of a search.

    ``peaks`` are at least a neighbourhood apart, best first, ``tail`` + 2 of them at most. ``lags``
    were compared. Of ``possible`` lags at which the clip lies within the reference's span,
    ``inside`` were compared. ``scorers`` compare at any lag, in the ``way`` that fitted best.
    """

    peaks: list[Peak]
    tail: int
    lags: int
    possible: int
    inside: int
    way: Way
    scorers: list[LagScorer]

    @property
    def coverage_ratio(self) -> float:
        """Compared share of the possible lags; 1 if there are none."""
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
    """Compare a track with a reference at every lag, in each way that the settings allow.

    Returns
    -------
    Search
        In the way that fits best.

    Raises
    ------
    UsageError
        If neither time step is a whole multiple of the other.
    """
    found = [_search(scorers, way) for way, scorers in prepared(track, grid, settings)]
    return max(found, key=lambda s: s.peaks[0].score if s.peaks else -np.inf)


def prepared(
    track: Track, grid: Grid, settings: MatchSettings
) -> Iterator[tuple[Way, list[LagScorer]]]:
    """Yield each way that the settings allow, with its scorers.

    A coarser reference has several scorers, one for each starting offset of the thinned track.

    Raises
    ------
    UsageError
        If neither time step is a whole multiple of the other.
    """
    ordinary_hz2 = 0.0
    grid = to_step_of(track, grid)
    for way in ways(track, grid, settings.smoothing):
        usable_s = way.track.usable * way.track.hop_s
        scorers = [
            LagScorer(t, way.grid.freq_hz, settings, usable_s)
            for t in phases(way.track, grid.step_s)
        ]
        # One ordinary variance for all ways, so that their scores are comparable.
        ordinary_hz2 = ordinary_hz2 or scorers[0].sample_ordinary_var()
        for scorer in scorers:
            scorer.ordinary_var_hz2 = ordinary_hz2
        yield way, scorers


def ways(track: Track, grid: Grid, smoothing: str) -> list[Way]:
    """Return the ways to make a track and a reference comparable.

    Estimates with a long window are averages, so the reference is averaged likewise. Published
    references are sometimes averages already: then they are taken as they are, and estimates with a
    short window are averaged instead.
    """
    if track.window_s <= grid.step_s:  # averaging the reference would change nothing
        step = _averaged(track, box_kernel(grid.step_s, track.hop_s), track.window_s)
        plain = Way(step, grid, "as it is")
        weights = window_kernel(USUAL_WINDOW_S, track.hop_s)
        coarse = _averaged(track, weights, USUAL_WINDOW_S)
        averaged = Way(coarse, grid, "taken as an average already")
        return [plain, averaged] if smoothing == "auto" and coarse.usable else [plain]
    plain = Way(track, grid, "as it is")
    freq_hz = average(grid.freq_hz, window_kernel(track.window_s, grid.step_s))
    smear = grid.freq_hz - freq_hz
    smear_var = float(np.nanvar(smear)) if np.isfinite(smear).any() else 0.0
    averaged = Way(track, replace(grid, freq_hz=freq_hz), "averaged like the estimates", smear_var)
    return {"window": [averaged], "none": [plain], "auto": [averaged, plain]}[smoothing]


def _averaged(track: Track, weights: FloatArray, window_s: float) -> Track:
    enf_hz = average(track.enf_hz, weights, MIN_AVERAGED)
    return replace(track, enf_hz=enf_hz, window_s=window_s)


def _search(scorers: list[LagScorer], way: Way) -> Search:
    """Scan all lags, keep the best of every stretch, and refine the best of those."""
    apart_s = NEIGHBOURHOOD_RATIO * scorers[0].track.resolution_s
    lags = possible = inside = 0
    score, lag, owner = [], [], []
    for number, scorer in enumerate(scorers):
        last = scorer.y.size - scorer.x.size
        for table in scorer.residuals():
            scores = scorer.scores(table.pairs, table.offset, table.residual_var)
            compared = np.isfinite(scores)
            within = (table.lags >= 0) & (table.lags <= last)
            lags += int(compared.sum())
            possible += int(within.sum())
            inside += int((within & compared).sum())
            best, where = stretch_maxima(scores, max(round(apart_s / scorer.track.hop_s), 1))
            score.append(best)
            lag.append(table.first_lag + where)
            owner.append(np.full(best.size, number))
    all_score, all_lag, all_owner = (np.concatenate(v) for v in (score, lag, owner))
    tail = min(MAX_TAIL, int(np.sqrt(all_score.size / len(scorers))))
    order = np.argsort(-all_score, kind="stable")[: SPARE * (tail + 2) * len(scorers)]
    refined = [scorers[all_owner[i]].peak(int(all_lag[i])) for i in order]
    peaks = _distinct(refined, apart_s)[: tail + 2]
    return Search(peaks, tail, lags, possible, inside, way, scorers)


def _distinct(peaks: list[Peak], apart_s: float) -> list[Peak]:
    """Sort best first and drop every peak too near to a better one."""
    out: list[Peak] = []
    for peak in sorted(peaks, key=lambda p: -p.score):
        if all(abs(peak.lag_s - other.lag_s) >= apart_s for other in out):
            out.append(peak)
    return out
