"""The score against lag, reduced to the resolution of a picture."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rsenf.match.correlate import LagScores
from rsenf.messages.schema import FloatArray

WHOLE_POINTS = 1000  # bins of lag: about the width of a picture in pixels
NEAR_S = 120.0  # distance from the best lag within which every lag is kept


@dataclass(frozen=True, eq=False)
class ScoreCurve:
    """Scores of a whole search in bins of lag, and all scores near the best lag.

    Parameters
    ----------
    name, unit : str
        Name of the score, and how to read it; empty if there is none.
    lag_s : ndarray, shape (n,)
        Mean lag of each bin that has any.
    low, high : ndarray, shape (n,)
        Minimum and maximum score in the bin; NaN if none could be computed.
    near_lag_s, near : ndarray, shape (m,)
        Every lag within ``NEAR_S`` of the best, and its score.
    """

    name: str
    unit: str
    lag_s: FloatArray
    low: FloatArray
    high: FloatArray
    near_lag_s: FloatArray
    near: FloatArray

    @property
    def is_empty(self) -> bool:
        """Whether there is no score to show."""
        return not np.isfinite(self.high).any()


def score_curve(
    pieces: Iterable[LagScores], first_s: float, last_s: float, best_lag_s: float
) -> ScoreCurve:
    """Reduce a curve given in pieces; memory doesn't grow with the number of lags.

    Parameters
    ----------
    pieces : iterable of LagScores
    first_s, last_s : float
        Bounds of the lags; lags outside go into the first and last bins.
    best_lag_s : float
        Lag around which every score is kept.
    """
    low, high = np.full(WHOLE_POINTS, np.nan), np.full(WHOLE_POINTS, np.nan)
    lag_sum, count = np.zeros(WHOLE_POINTS), np.zeros(WHOLE_POINTS)
    near: list[LagScores] = []
    name = unit = ""
    for piece in pieces:
        name, unit = piece.name, piece.unit
        place = (piece.lag_s - first_s) / (last_s - first_s) * WHOLE_POINTS
        stretch = np.clip(place.astype(np.int64), 0, WHOLE_POINTS - 1)
        starts = np.flatnonzero(np.diff(stretch, prepend=-1))
        of = stretch[starts]
        low[of] = np.fmin(low[of], np.fmin.reduceat(piece.score, starts))
        high[of] = np.fmax(high[of], np.fmax.reduceat(piece.score, starts))
        lag_sum[of] += np.add.reduceat(piece.lag_s, starts)
        count[of] += np.diff(starts, append=piece.lag_s.size)
        close = np.abs(piece.lag_s - best_lag_s) <= NEAR_S
        near.append(LagScores(piece.lag_s[close], piece.score[close], name, unit))
    held = count > 0
    near_lag_s, near_score = _merged(near)
    return ScoreCurve(
        name, unit, lag_sum[held] / count[held], low[held], high[held], near_lag_s, near_score
    )


def no_curve() -> ScoreCurve:
    """Return the curve of a search that compared nothing."""
    nothing = np.empty(0)
    return ScoreCurve("score", "nothing compared", *[nothing] * 5)


def _merged(pieces: list[LagScores]) -> tuple[FloatArray, FloatArray]:
    """Merge pieces in the order of lag; of equal lags the higher score counts."""
    lag_s = np.concatenate([np.empty(0), *(p.lag_s for p in pieces)])
    score = np.concatenate([np.empty(0), *(p.score for p in pieces)])
    lags, starts = np.unique(lag_s[order := np.argsort(lag_s, kind="stable")], return_index=True)
    return lags, np.fmax.reduceat(score[order], starts) if lags.size else lags
