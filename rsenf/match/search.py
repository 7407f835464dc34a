"""Finds the lags at which a clip's frequency fits a reference, and weighs the best of them.

Model: that of :mod:`rsenf.match.score`.

Statistic: three tests, none of which is a threshold on the correlation:

* Does another time fit nearly as well? The likelihood ratio of the best two peaks.
* Would the best of this many *wrong* lags fit as well by chance? The scores of wrong lags have an
  exponential upper tail: a residual variance ``V`` made of ``d`` components of the grid is below
  ``v`` with a probability that goes as ``v^(d/2)``, and the score is a logarithm of ``V``. The
  rate of the tail is estimated from the other peaks of the same search. So a quiet clip, a short
  clip or a larger reference need a better fit without further settings.
* Is the residual as small as the estimates' stated errors imply? An F test.

Approximate: wrong lags are taken as independent.

References
----------
- Pickands, J. (1975), Statistical inference using extreme order statistics, Annals of Statistics 3,
  119.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rsenf.match.clip_phase import average, box_kernel, window_kernel
from rsenf.match.score import FLOOR_STD_HZ, LagScorer, Peak, independent_values, stretch_maxima
from rsenf.match.series import Grid, Track, phases, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

NEIGHBOURHOOD_RATIO = 1.5  # of the resolution: nearer lags belong to the same peak
USUAL_WINDOW_S = 20.0  # of references that are averages
MIN_AVERAGED = 0.8  # share of an average's weights that must fall on valid estimates
MAX_TAIL = 64  # most peaks that describe the tail of wrong lags
SPARE = 4  # factor on the peaks to refine: a broad peak can be the best of several stretches
# Gamma prior of the tail: worth three peaks; its mean excess over the threshold is PRIOR_EXCESS
# times the root of the number of independent values. On half a day of the continental grid and a
# day of the US one, for clips of 1 to 10 minutes, this factor was 0.45 to 0.66.
PRIOR_PEAKS = 3.0
PRIOR_EXCESS = 0.6
# Degrees of freedom of the expected variance, which is known within a factor of about two.
EXPECTED_DOF = 4.0
# Largest log10 likelihood ratio that the calibration supports: it had about a thousand pairs.
MAX_VERBAL_LOG10 = 3.0
SCALE = (  # ENFSI Guideline for Evaluative Reporting in Forensic Science, 2015
    (6.0, "extremely strong support"),
    (4.0, "very strong support"),
    (3.0, "strong support"),
    (2.0, "moderately strong support"),
    (1.0, "moderate support"),
    (math.log10(2.0), "weak support"),
)


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


@dataclass(frozen=True)
class Evidence:
    """Evidence for the best peak of a search.

    ``log10_lr`` is against the second best peak (NaN without one) and ``log10_lr_absent`` against
    the true time not being in the reference. ``chance`` is the expected number of wrong lags in the
    search that fit at least as well, and ``fit`` the probability of so large a residual at the true
    time, where ``expected_var_hz2`` is its expected variance.
    """

    log10_lr: float
    chance: float
    log10_lr_absent: float
    fit: float
    expected_var_hz2: float


def weigh(found: Search, track: Track, settings: MatchSettings) -> Evidence:
    """Weigh the best peak of a search; the search must have one."""
    best, others = found.peaks[0], found.peaks[1:]
    chance = track.hypotheses * expected_chance_fits(found, track.resolution_s)
    fit, expected = fit_of(best, found, track, settings)
    # A residual up to the median is no evidence against this time.
    against = min(0.0, math.log10(max(2.0 * fit, 1e-300)))
    return Evidence(
        log10_lr=(best.score - others[0].score) / math.log(10.0) if others else math.nan,
        chance=chance,
        log10_lr_absent=_log10_lr_of_chance(chance) + against,
        fit=fit,
        expected_var_hz2=expected,
    )


def expected_chance_fits(found: Search, resolution_s: float) -> float:
    """Return the expected number of wrong lags that fit as well as the best (Pickands 1975).

    With the excesses ``e_i`` of the ``K`` next best peaks over the one after them, and a gamma
    prior worth ``k0`` peaks of excess ``m``, the predictive tail at an excess ``s`` is
    ``K · (1 + s / (Σe_i + k0·m))^−(K + k0)``: an exponential tail whose rate is uncertain.
    """
    best, others = found.peaks[0], [p.score for p in found.peaks[1:]]
    if not others:
        return math.inf
    tail = min(max(found.tail, 1), max(len(others) - 1, 1))
    threshold = others[min(tail, len(others) - 1)]
    values = independent_values(best.seconds, resolution_s)
    known = sum(s - threshold for s in others[:tail])
    known += PRIOR_PEAKS * PRIOR_EXCESS * math.sqrt(max(values, 1.0))
    return float(tail * (1.0 + (best.score - threshold) / known) ** -(tail + PRIOR_PEAKS))


def fit_of(peak: Peak, found: Search, track: Track, settings: MatchSettings) -> tuple[float, float]:
    """F test of a peak's residual: the probability of one so large at the true time.

    The expected variance is that of the estimates and of the reference. Estimates state their
    variance about the grid's 1 s mean; if the reference was averaged like them, the part that
    averaging explains is subtracted. An F test and not a chi-squared test, since the sizes of the
    errors are known only roughly.

    Returns
    -------
    fit : float
        Between 0 and 1.
    expected_var_hz2 : float
    """
    from scipy.special import fdtrc

    var = track.var_hz2[np.isfinite(track.var_hz2)]
    estimate_var = max(float(var.mean()) - found.way.smear_var_hz2, 0.0) if var.size else 0.0
    expected = max(estimate_var + settings.reference_std_hz**2, FLOOR_STD_HZ**2)
    freedom = max(independent_values(peak.seconds, track.resolution_s) - 1.0, 1.0)
    return float(fdtrc(freedom, EXPECTED_DOF, peak.residual_var_hz2 / expected)), expected


def _log10_lr_of_chance(chance: float) -> float:
    """Convert an expected number of chance fits to a conservative log10 likelihood ratio.

    A significance ``p`` supports a likelihood ratio of at most ``1 / (−e·p·ln p)`` (Sellke, Bayarri
    & Berger, The American Statistician 55, 2001); ``1/p`` would overstate it.
    """
    p = max(-math.expm1(-chance), 1e-300)
    return -math.log10(-math.e * p * math.log(p)) if p < 1 / math.e else 0.0


def verbal(log10_lr: float, what: str = "this time") -> str:
    """Return a likelihood ratio in words, on the scale of the ENFSI guideline (2015).

    Parameters
    ----------
    log10_lr : float
        NaN gives an empty text. Support is capped at :data:`MAX_VERBAL_LOG10`.
    what : str
        The proposition that the ratio is for.

    Examples
    --------
    >>> verbal(2.3)
    'moderately strong support for this time'
    >>> verbal(-1.5)
    'moderate support against this time'
    """
    if math.isnan(log10_lr):
        return ""
    size = min(abs(log10_lr), MAX_VERBAL_LOG10)
    side = f"for {what}" if log10_lr > 0 else f"against {what}"
    for limit, words in SCALE:
        if size >= limit:
            return f"{words} {side}"
    return "no support either way"
