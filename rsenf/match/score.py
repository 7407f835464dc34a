"""Scores lags by the frequency residual: each one, a peak below one step, and a survey of them all.

Model: residuals are Gaussian of unknown variance about a constant offset, whose prior is a Student
distribution of camera clock errors.

Likelihood: of the residual's size and the offset (a clock error of 100 ppm is 5 mHz), which carry
more information than a correlation, which ranks a lag by shape only. All three come from the same
masked sums (:mod:`rsenf.match.ncc`). The survey finds the lags worth scoring with the phase filter.
It takes the reference in pieces, so a year needs no more memory than a day; of each stretch of 8 s
the best lag is kept, and of those the best few hundred. A reference longer than a piece is searched
from coarse to fine: means of 8 s first, which a stored one keeps, then every lag near the best.

Approximate: windows of 20 s that move on by 1 s overlap, and a grid changes slowly, so there are
far fewer independent values than seconds: one per half resolution, as with half-overlapping
segments.

References
----------
- Welch, P. D. (1967), The use of fast Fourier transform for the estimation of power spectra, IEEE
  Trans. Audio and Electroacoustics 15, 70.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.match.ncc import LagResult, LagTable, Residuals, compare_at, lag_residuals, lag_tables
from rsenf.match.series import Grid, Track, phases, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.medians import means
from rsenf.messages.schema import FloatArray

INDEPENDENT_RATIO = 0.5  # of the resolution: the spacing at which residuals count as independent
CLOCK_DOF = 3.0  # degrees of freedom of the Student prior, for the tails of real cameras
# Two good recordings of one grid differ by this much; a smaller residual is no better.
FLOOR_STD_HZ = 1e-4
SAMPLED_LAGS = 401  # for the residual variance of an ordinary lag
PIECE = 1 << 20  # samples of the reference at a time
STRETCH_S = 8.0  # of lags, of which only the best is kept
KEPT = 512  # lags of a search
# Means of this length are compared first in a reference longer than a piece, if a clip has enough.
COARSE_S, LEAST_COARSE = 8.0, 12


@dataclass(frozen=True)
class Peak:
    """One lag with its comparison, refined to a fraction of a step.

    ``score`` is the log-likelihood (nats) less that of an ordinary lag. ``bend_hz2_per_s2`` is the
    increase of the residual variance per squared distance from the lag; 0 if it has no minimum
    there.
    """

    lag_s: float
    score: float
    seconds: float
    correlation: float
    offset_hz: float
    residual_var_hz2: float
    bend_hz2_per_s2: float


def independent_values(seconds: float, resolution_s: float) -> float:
    """Return the number of independent residuals in some seconds (Welch 1967).

    Parameters
    ----------
    seconds : float
    resolution_s : float
        Correlation time of the residuals.

    Examples
    --------
    >>> independent_values(120.0, 20.0)
    12.0
    """
    return seconds / (INDEPENDENT_RATIO * resolution_s)


class LagScorer:
    """Compares a track with a reference on the track's step.

    Parameters
    ----------
    track : Track
    freq_hz : ndarray, shape (N,)
        The reference, NaN in gaps.
    settings : MatchSettings
    usable_s : float
        Usable seconds of the whole clip; a lag must use a minimum share of them.
    """

    def __init__(
        self, track: Track, freq_hz: FloatArray, settings: MatchSettings, usable_s: float
    ) -> None:
        self.track, self.settings = track, settings
        self.x, self.x_ok = track.enf_hz, np.isfinite(track.enf_hz)
        self.y, self.y_ok = freq_hz, np.isfinite(freq_hz)
        least_s = max(settings.min_overlap * usable_s, settings.min_seconds)
        self.min_pairs = max(3, int(np.ceil(least_s / track.hop_s)))
        self.ordinary_var_hz2 = 1.0

    def lag_s(self, lag: float) -> float:
        """Start of the clip on the reference's axis if value 0 is paired with sample ``lag``."""
        return (lag + 0.5) * self.track.hop_s - self.track.first_s

    def lags_s(self, lags: NDArray[np.int64]) -> FloatArray:
        """Return the same for many lags."""
        return np.asarray((lags + 0.5) * self.track.hop_s - self.track.first_s, np.float64)

    def nearest_lag(self, lag_s: float) -> int:
        """Inverse of :meth:`lag_s`."""
        return round((lag_s + self.track.first_s) / self.track.hop_s - 0.5)

    def residuals(self, lags: range | None = None) -> Iterator[Residuals]:
        """Compare at every lag, or at those in a range."""
        return lag_residuals(
            self.x, self.x_ok, self.y, self.y_ok, min_pairs=self.min_pairs, lags=lags
        )

    def tables(self) -> Iterator[LagTable]:
        """Compare at every lag, with the correlation."""
        return lag_tables(self.x, self.x_ok, self.y, self.y_ok, min_pairs=self.min_pairs)

    def scores(self, pairs: NDArray[np.int64], offset: FloatArray, var: FloatArray) -> FloatArray:
        """Log-likelihood of each lag less that of an ordinary one (nats); NaN where not compared.

        Fewer pairs give less evidence, for or against.

        Parameters
        ----------
        pairs, offset, var : ndarray, shape (c,)
            Number of pairs, mean residual (Hz) and residual variance (Hz²) of each lag.
        """
        values = independent_values(1.0, self.track.resolution_s) * self.track.hop_s * pairs
        ratio = np.maximum(var, FLOOR_STD_HZ**2) / self.ordinary_var_hz2
        ppm = offset / self.track.nominal_hz * 1e6
        clock = np.log1p((ppm / self.settings.clock_scale_ppm) ** 2 / CLOCK_DOF)
        score = -0.5 * np.maximum(values - 1, 0) * np.log(ratio) - 0.5 * (CLOCK_DOF + 1) * clock
        return np.asarray(score, np.float64)

    def most_var_hz2(self, score: float) -> float:
        """Upper limit of the residual variance of lags with a better score than a given one."""
        values = independent_values(self.x.size * self.track.hop_s, self.track.resolution_s)
        if score <= 0.0 or values <= 1.0:
            return np.inf
        return float(self.ordinary_var_hz2 * np.exp(-2.0 * score / (values - 1.0)))

    def sample_ordinary_var(self) -> float:
        """Residual variance of an ordinary lag: the median over lags spread over the reference."""
        lags = np.linspace(1 - self.x.size, self.y.size - 1, SAMPLED_LAGS).astype(int)
        found = [self._at(int(lag)) for lag in np.unique(lags)]
        variances = [c.residual_var for c in found if c.pairs >= self.min_pairs]
        fallback = self.y[self.y_ok].var() if self.y_ok.any() else 0.0
        return max(float(np.median(variances) if variances else fallback), FLOOR_STD_HZ**2)

    def peak(self, lag: int) -> Peak:
        """Compare at a lag; interpolate to the vertex of the parabola if it is a local minimum.

        Near the true lag the residual variance is a parabola: a shift ``δ`` adds ``δ²`` times the
        mean square of the reference's slope.
        """
        here, before, after = self._at(lag), self._at(lag - 1), self._at(lag + 1)
        shift, bend = 0.0, 0.0
        if min(before.pairs, after.pairs) >= self.min_pairs:
            bend = max((before.residual_var + after.residual_var) / 2 - here.residual_var, 0.0)
            if here.residual_var < min(before.residual_var, after.residual_var):
                shift = (before.residual_var - after.residual_var) / (4 * bend)
        three = (before, here, after) if shift else (here, here, here)
        var = max(_quadratic([c.residual_var for c in three], shift), 0.0)
        offset = _quadratic([c.offset for c in three], shift)
        correlation = _quadratic([c.correlation for c in three], shift)
        score = self.scores(np.array([here.pairs]), np.array([offset]), np.array([var]))
        return Peak(
            lag_s=self.lag_s(lag + shift),
            score=float(score[0]),
            seconds=here.pairs * self.track.hop_s,
            correlation=float(np.clip(correlation, -1.0, 1.0)),
            offset_hz=offset,
            residual_var_hz2=var,
            bend_hz2_per_s2=bend / self.track.hop_s**2,
        )

    def _at(self, lag: int) -> LagResult:
        return compare_at(self.x, self.x_ok, self.y, self.y_ok, lag)


def _quadratic(three: list[float], shift: float) -> float:
    """Value of the parabola through points at −1, 0 and 1."""
    a, b, c = three
    return b + shift * (c - a) / 2 + shift**2 * ((a + c) / 2 - b)


@dataclass(frozen=True, eq=False)
class Survey:
    """Result of scanning all lags."""

    # (c,) the most promising lags, best first, and their log-likelihood scores (nats)
    lag_s: FloatArray
    score: FloatArray
    lags: int  # number of lags compared
    # number of lags at which the clip lies within the reference's span, and how many of these were
    # compared
    possible: int
    inside: int


def survey(track: Track, grid: Grid, settings: MatchSettings, kept: int = KEPT) -> Survey:
    """Score every lag of a reference and keep the best ``kept``.

    A long reference is searched from coarse to fine: by means over ``COARSE_S`` first, then by
    every lag near the best of those.

    Raises
    ------
    UsageError
        If neither time step is a whole multiple of the other.
    """
    many = round(COARSE_S / track.hop_s)
    is_long = grid.freq_hz.size > PIECE and grid.step_s <= track.hop_s * (1 + 1e-6)
    if many < 2 or not is_long or track.enf_hz.size < LEAST_COARSE * many:
        return _scanned(track, grid, settings, kept)
    whole = track.enf_hz.size // many * many
    coarse = replace(
        track.part(0, slice(0, whole, many), many * track.hop_s),
        first_s=track.first_s + (many - 1) / 2 * track.hop_s,
        enf_hz=means(track.enf_hz, many),
    )
    at_means, begin_s = _means_of(grid, coarse.hop_s)
    found = _scanned(coarse, at_means, settings, kept, interpolate=True)
    # In order of time, so that a reference on disk is read once.
    places_s = np.sort(begin_s + found.lag_s)
    near = [_best_near(track, grid, settings, lag_s, many) for lag_s in places_s]
    # Neighbouring places may have the same best lag.
    lag_s, score = np.array(sorted({one for one in near if one})).reshape(-1, 2).T
    lags, possible, inside = (n * many for n in (found.lags, found.possible, found.inside))
    return Survey(*_best(lag_s, score, kept), lags, possible, inside)


def _means_of(grid: Grid, hop_s: float) -> tuple[Grid, float]:
    """Return the means that a stored reference has, if a hop holds whole ones, and their start (s).

    Otherwise, the reference itself.
    """
    if (means_of := getattr(grid.freq_hz, "means", None)) is None:
        return grid, 0.0
    many, before, freq_hz = means_of()
    in_hop = hop_s / (many * grid.step_s)
    if round(in_hop) < 1 or abs(in_hop - round(in_hop)) > 1e-6:
        return grid, 0.0
    return replace(grid, step_s=many * grid.step_s, freq_hz=freq_hz), before * grid.step_s


def _best_near(
    track: Track, grid: Grid, settings: MatchSettings, lag_s: float, reach: int
) -> tuple[float, float] | None:
    """Return the best lag (s) within ``reach`` hops of a given one, and its score, if any."""
    hop_s, count = track.hop_s, track.enf_hz.size
    per_hop = round(hop_s / grid.step_s)
    scorer = LagScorer(track, np.empty(0), settings, track.usable * hop_s)
    scorer.ordinary_var_hz2 = _ordinary_hz2(track)
    first = scorer.nearest_lag(lag_s) - reach
    start, stop = max(first, 0), first + count + 2 * reach
    part = replace(grid, freq_hz=grid.freq_hz[start * per_hop : stop * per_hop])
    near_hz = np.full(count + 2 * reach, np.nan)
    freq_hz = to_step_of(track, part).freq_hz
    near_hz[start - first : start - first + freq_hz.size] = freq_hz
    away_hz = track.enf_hz - np.lib.stride_tricks.sliding_window_view(near_hz, count)
    ok = np.isfinite(away_hz)
    pairs = ok.sum(axis=1)
    n = np.maximum(pairs, 1)
    offset_hz = np.where(ok, away_hz, 0.0).sum(axis=1) / n
    var_hz2 = (np.where(ok, away_hz - offset_hz[:, None], 0.0) ** 2).sum(axis=1) / n
    score = scorer.scores(pairs, offset_hz, var_hz2)
    score[pairs < scorer.min_pairs] = -np.inf
    best = int(score.argmax())
    return (scorer.lag_s(first + best), float(score[best])) if np.isfinite(score[best]) else None


def _scanned(
    track: Track, grid: Grid, settings: MatchSettings, kept: int, *, interpolate: bool = False
) -> Survey:
    """Score every lag; with ``interpolate``, as if the best were between two of the lags."""
    lag_s, score = np.empty(0), np.empty(0)
    lags = possible = inside = 0
    least = -np.inf
    for table, scorer, begin_s in _tables(track, grid, settings):
        compared = np.isfinite(table.residual_var)
        var_hz2 = _vertices(table.residual_var) if interpolate else table.residual_var
        hopeful = np.flatnonzero(var_hz2 < scorer.most_var_hz2(least))
        found = np.full(table.pairs.size, np.nan)
        found[hopeful] = scorer.scores(
            table.pairs[hopeful], table.offset[hopeful], var_hz2[hopeful]
        )
        hop_s = scorer.track.hop_s
        last = int(grid.duration_s / hop_s + 1e-6) - scorer.x.size
        first = table.first_lag + round(begin_s / hop_s)
        span = slice(max(-first, 0), max(last + 1 - first, 0))
        lags += int(compared.sum())
        possible += compared[span].size
        inside += int(compared[span].sum())
        best, where = stretch_maxima(found, max(round(STRETCH_S / hop_s), 1))
        better = best > least
        at_s = begin_s + scorer.lags_s(table.first_lag + where[better])
        lag_s, score = np.concatenate([lag_s, at_s]), np.concatenate([score, best[better]])
        if score.size > 4 * kept:
            lag_s, score = _best(lag_s, score, kept)
            least = score[-1]
    return Survey(*_best(lag_s, score, kept), lags, possible, inside)


def _vertices(var: FloatArray) -> FloatArray:
    """Replace each local minimum by the vertex of the parabola through it and its neighbours."""
    out = var.copy()
    before, here, after = var[:-2], var[1:-1], var[2:]
    at = np.flatnonzero((here < before) & (here < after))
    slope, bend = (after - before)[at], (before - 2.0 * here + after)[at]
    out[1 + at] -= slope**2 / (8.0 * bend)
    return out


def _tables(
    track: Track, grid: Grid, settings: MatchSettings
) -> Iterator[tuple[Residuals, LagScorer, float]]:
    """Yield residuals, each lag's once, with their scorer and the start of their piece (s)."""
    usable_s = track.usable * track.hop_s
    # A finer reference is averaged over the hop, so a piece must hold whole hops.
    per_hop = max(round(track.hop_s / grid.step_s), 1)
    piece = PIECE // per_hop * per_hop
    reach = int(np.ceil(track.enf_hz.size * track.hop_s / grid.step_s)) + 2 * per_hop
    reach = -(-reach // per_hop) * per_hop
    for start in range(0, grid.freq_hz.size, piece):
        stop = min(start + piece + reach, grid.freq_hz.size)
        part = to_step_of(track, replace(grid, freq_hz=grid.freq_hz[start:stop]))
        for thin in phases(track, part.step_s):
            scorer = LagScorer(thin, part.freq_hz, settings, usable_s)
            scorer.ordinary_var_hz2 = _ordinary_hz2(track)
            within = range(1 - thin.enf_hz.size if start == 0 else 0, piece // per_hop)
            for table in scorer.residuals(within):
                yield table, scorer, start * grid.step_s


def _ordinary_hz2(track: Track) -> float:
    """Residual variance of a wrong lag: twice the variance of the grid's frequency.

    Without this scale, wrong lags near a gap of the reference would beat the right one, only
    because fewer values are compared there.
    """
    enf_hz = track.enf_hz[np.isfinite(track.enf_hz)]
    return max(2.0 * float(enf_hz.var()) if enf_hz.size else 0.0, FLOOR_STD_HZ**2)


def stretch_maxima(scores: FloatArray, length: int) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the best finite score of every ``length`` lags, and its index; none if all are NaN.

    Examples
    --------
    >>> best, where = stretch_maxima(np.array([1.0, 3.0, np.nan, np.nan, 2.0]), 2)
    >>> best.tolist(), where.tolist()
    ([3.0, 2.0], [1, 4])
    """
    if length == 1:
        where = np.flatnonzero(np.isfinite(scores))
        return scores[where], where
    padded = np.full(-(-scores.size // length) * length, -np.inf)
    padded[: scores.size] = np.where(np.isfinite(scores), scores, -np.inf)
    rows = padded.reshape(-1, length)
    where = rows.argmax(axis=1) + np.arange(rows.shape[0]) * length
    best = padded[where]
    found = np.isfinite(best)
    return best[found], where[found]


def _best(lag_s: FloatArray, score: FloatArray, kept: int) -> tuple[FloatArray, FloatArray]:
    order = np.argsort(-score, kind="stable")[:kept]
    return lag_s[order], score[order]
