"""The correlation at every lag: the curve that a report shows.

It is the correlation whatever the matcher decides by, because a layman can read it. It comes in
pieces, so that a year of lags is never in memory; the caller keeps what a picture can show.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from rsenf.match.coarse import PIECE
from rsenf.match.score import LagScorer
from rsenf.match.search import USUAL_WINDOW_S, prepared
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray


@dataclass(frozen=True, eq=False)
class LagScores:
    """Scores of some lags; larger is better.

    Parameters
    ----------
    lag_s : ndarray, shape (n,)
        Start of the clip less the start of the reference's first sample; rising.
    score : ndarray, shape (n,)
        NaN where the two could not be compared.
    name, unit : str
        Name of the score and how to read it, such as ``correlation`` and ``1 is perfect``.
    """

    lag_s: FloatArray
    score: FloatArray
    name: str
    unit: str


def lag_scores(
    track: Track, grid: Grid, settings: MatchSettings, best_lag_s: float
) -> Iterator[LagScores]:
    """Yield the normalised cross-correlation at every lag, with the smoothing that fits best.

    Parameters
    ----------
    track : Track
        As the matcher saw it, without outliers.
    grid : Grid
    settings : MatchSettings
    best_lag_s : float
        The lag that the matcher found; the smoothing is the one that fits best there.

    Yields
    ------
    LagScores
        Lags rise within a piece. Pieces may overlap or interleave; the best score of a lag counts.
    """
    way = 0
    for part in _parts(track, grid):
        if part.first_lag_s <= best_lag_s < part.last_lag_s:
            way = _best_way(track, part.grid, settings, best_lag_s - part.begin_s)
    for part in _parts(track, grid):
        ((_, scorers),) = islice(prepared(track, part.grid, settings), way, way + 1)
        for scorer in scorers:
            for table in scorer.tables():
                lag_s = scorer.lags_s(table.lags) + part.begin_s
                in_piece = (lag_s >= part.first_lag_s) & (lag_s < part.last_lag_s)
                if in_piece.any():
                    score = table.correlation[in_piece]
                    yield LagScores(lag_s[in_piece], score, "correlation", "1 is perfect")


class _Part(NamedTuple):
    """A part of a reference, its start, and the range of lags that are reported from it."""

    grid: Grid
    begin_s: float
    first_lag_s: float
    last_lag_s: float


def _parts(track: Track, grid: Grid) -> Iterator[_Part]:
    """Cut a reference into parts that overlap by a clip and the longest window on either side."""
    per_hop = max(round(track.hop_s / grid.step_s), 1)  # a part holds whole hops
    clip_s = track.enf_hz.size * track.hop_s + track.window_s + USUAL_WINDOW_S
    reach = math.ceil(clip_s / grid.step_s / per_hop) * per_hop
    piece = PIECE // per_hop * per_hop
    size = grid.freq_hz.size
    for start in range(0, size, piece):
        a, b = max(start - reach, 0), min(start + piece + reach, size)
        yield _Part(
            replace(grid, freq_hz=np.asarray(grid.freq_hz[a:b])),
            a * grid.step_s,
            start * grid.step_s if start else -math.inf,
            (start + piece) * grid.step_s if start + piece < size else math.inf,
        )


def _best_way(track: Track, grid: Grid, settings: MatchSettings, lag_s: float) -> int:
    """Return the index of the smoothing (:func:`rsenf.match.search.ways`) that fits best."""
    found = [_score_at(lag_s, scorers) for _, scorers in prepared(track, grid, settings)]
    return found.index(max(found))


def _score_at(lag_s: float, scorers: list[LagScorer]) -> float:
    found = [scorer.peak(scorer.nearest_lag(lag_s)).score for scorer in scorers]
    return max((score for score in found if not math.isnan(score)), default=-math.inf)
