"""A curve of scores against lag, cut down to what a picture can show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rsenf.match.lag_scores import LagScores
from rsenf.messages.schema import FloatArray

WHOLE_POINTS = 1000  # as fine as a picture is wide
NEAR_S = 120.0  # how far around the best lag every lag is kept


@dataclass(frozen=True, eq=False)
class ScoreCurve:
    """Scores of a whole search, and all of those near its best lag.

    Parameters
    ----------
    name, unit : str
        What the score is and how to read it; empty when there is no score.
    lag_s : ndarray, shape (n,)
        Middle of each stretch of lags that holds any.
    low, high : ndarray, shape (n,)
        Least and greatest score in the stretch; NaN where none could be compared.
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
    """Take in a curve piece by piece; memory doesn't grow with the number of lags.

    Parameters
    ----------
    pieces : iterable of LagScores
    first_s, last_s : float
        Bounds of the lags; what lies outside goes into the outermost stretches.
    best_lag_s : float
        Where to keep every lag.
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
    """Put pieces in the order of their lags; of a lag that comes twice the better score counts."""
    lag_s = np.concatenate([np.empty(0), *(p.lag_s for p in pieces)])
    score = np.concatenate([np.empty(0), *(p.score for p in pieces)])
    lags, starts = np.unique(lag_s[order := np.argsort(lag_s, kind="stable")], return_index=True)
    return lags, np.fmax.reduceat(score[order], starts) if lags.size else lags
