"""Coarse search: scans all lags of a reference for those worth scoring with the phase filter.

Computes the variance of the frequency residual about a constant offset at each lag by FFT
(:mod:`rsenf.match.ncc`). The reference is taken in pieces, so a year needs no more memory than a
day. Of each stretch of 8 s the best lag is kept, and of those the best few hundred of the search.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.match.ncc import Residuals
from rsenf.match.score import FLOOR_STD_HZ, LagScorer
from rsenf.match.series import Grid, Track, phases, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

PIECE = 1 << 20  # samples of the reference at a time
STRETCH_S = 8.0  # of lags, of which only the best is kept
KEPT = 512  # lags of a search


@dataclass(frozen=True, eq=False)
class Survey:
    """Result of scanning all lags.

    Attributes
    ----------
    lag_s, score : ndarray, shape (c,)
        The most promising lags, best first, and their log-likelihood scores (nats).
    lags : int
        Number of lags compared.
    possible, inside : int
        Number of lags at which the clip lies within the reference's span, and how many of these
        were compared.
    """

    lag_s: FloatArray
    score: FloatArray
    lags: int
    possible: int
    inside: int

    @property
    def coverage_ratio(self) -> float:
        """Compared share of the possible lags; 1 if there are none."""
        return self.inside / self.possible if self.possible else 1.0


def survey(track: Track, grid: Grid, settings: MatchSettings, kept: int = KEPT) -> Survey:
    """Score every lag of a reference and keep the best ``kept``.

    Raises
    ------
    UsageError
        If neither time step is a whole multiple of the other.
    """
    lag_s, score = np.empty(0), np.empty(0)
    lags = possible = inside = 0
    least = -np.inf
    for table, scorer, begin_s in _tables(track, grid, settings):
        found = scorer.scores(table.pairs, table.offset, table.residual_var)
        compared = np.isfinite(found)
        hop_s = scorer.track.hop_s
        last = int(grid.duration_s / hop_s + 1e-6) - scorer.x.size
        first = table.first_lag + round(begin_s / hop_s)
        span = slice(max(-first, 0), max(last + 1 - first, 0))
        lags += int(compared.sum())
        possible += compared[span].size
        inside += int(compared[span].sum())
        best, where = stretch_maxima(found, max(round(STRETCH_S / hop_s), 1))
        hopeful = best > least
        at_s = begin_s + scorer.lags_s(table.first_lag + where[hopeful])
        lag_s, score = np.concatenate([lag_s, at_s]), np.concatenate([score, best[hopeful]])
        if score.size > 4 * kept:
            lag_s, score = _best(lag_s, score, kept)
            least = score[-1]
    return Survey(*_best(lag_s, score, kept), lags, possible, inside)


def _tables(
    track: Track, grid: Grid, settings: MatchSettings
) -> Iterator[tuple[Residuals, LagScorer, float]]:
    """Compare the reference piece by piece, each lag once.

    Yields the residuals, the scorer that made them, and the start of the piece (s).
    """
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
            for table in scorer.residuals():
                kept = table.within(within)
                if kept.pairs.size:
                    yield kept, scorer, start * grid.step_s


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
