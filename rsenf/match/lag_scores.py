"""How well a clip fits at every lag: the curve that a person is shown.

A method shows the score that it ranks lags by, if it has one of its own in :data:`CURVES`; every
other shows the correlation. Curves come in pieces, so that a year of lags is never held at once:
who draws one keeps what the picture can show.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rsenf.match.score import LagScorer
from rsenf.match.search import prepared
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray


@dataclass(frozen=True, eq=False)
class LagScores:
    """Scores of some lags, the larger the better.

    Parameters
    ----------
    lag_s : ndarray, shape (n,)
        Start of the clip, from the start of the reference's first sample; rising.
    score : ndarray, shape (n,)
        NaN where the two could not be compared.
    name, unit : str
        What the score is and how to read it, such as ``correlation`` and ``1 is perfect``.
    """

    lag_s: FloatArray
    score: FloatArray
    name: str
    unit: str


class Curve(Protocol):
    """The scores of a method at every lag, in pieces.

    Lags rise within a piece; pieces may overlap or interleave, and the best score of a lag counts.
    """

    def __call__(
        self, track: Track, grid: Grid, settings: MatchSettings, best_lag_s: float
    ) -> Iterator[LagScores]:
        """Yield them; ``best_lag_s`` is the lag that the method found."""
        ...


def lag_scores(
    method: str, track: Track, grid: Grid, settings: MatchSettings, best_lag_s: float
) -> Iterator[LagScores]:
    """Yield the scores that a method shows for every lag.

    Parameters
    ----------
    method : str
        Name of the matcher.
    track : Track
        As the matcher saw it, jumps left out.
    grid : Grid
    settings : MatchSettings
    best_lag_s : float
        The lag that the method found.
    """
    return CURVES.get(method, correlations)(track, grid, settings, best_lag_s)


def correlations(
    track: Track, grid: Grid, settings: MatchSettings, best_lag_s: float
) -> Iterator[LagScores]:
    """Yield the normalised cross-correlation at every lag, in the way that fits best."""
    ways = [scorers for _, scorers in prepared(track, grid, settings)]
    for scorer in max(ways, key=lambda scorers: _score_at(best_lag_s, scorers)):
        for table in scorer.tables():
            lags = table.lags.astype(np.float64)
            lag_s = (lags + 0.5) * scorer.track.hop_s - scorer.track.first_s
            yield LagScores(lag_s, table.correlation, "correlation", "1 is perfect")


def _score_at(lag_s: float, scorers: list[LagScorer]) -> float:
    found = [scorer.peak(scorer.nearest_lag(lag_s)).score for scorer in scorers]
    return max((score for score in found if not math.isnan(score)), default=-math.inf)


CURVES: dict[str, Curve] = {"ncc": correlations}
