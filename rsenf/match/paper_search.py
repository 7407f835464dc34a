"""Every hypothesis of the paper's against a reference, at every lag.

Section V of the paper: the ENF of each hypothesis is correlated with the reference, and the peak of
the correlation and its lag are kept. What is made of them is for the metrics to say.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.match.paper_lags import best_lags
from rsenf.match.paper_tracks import Hypotheses
from rsenf.match.search import ways
from rsenf.match.series import Grid, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray


@dataclass(frozen=True, eq=False)
class Tally:
    """The peak of every hypothesis's correlation, and where it is; arrays of shape (hypotheses,).

    NaN where no lag could be compared. ``seconds`` were compared at the peak, ``offset_hz`` is the
    ENF less the reference there. ``lags`` were compared of each.
    """

    hypotheses: Hypotheses
    settings: MatchSettings
    lag_s: FloatArray
    correlation: FloatArray
    offset_hz: FloatArray
    seconds: FloatArray
    lags: int


def paper_search(hypotheses: Hypotheses, grid: Grid, settings: MatchSettings) -> Tally:
    """Correlate every hypothesis with a reference at every lag.

    Estimates of a 20 s window are averages, and so is the paper's reference, whose ENF is taken
    with the same window: so the reference is averaged alike, unless ``smoothing`` is ``none``.
    Windows that one hypothesis lacks are left out for all.

    Parameters
    ----------
    hypotheses : Hypotheses
        Of one nominal frequency, the reference's.
    grid : Grid
    settings : MatchSettings

    Raises
    ------
    UsageError
        When the steps of the two don't fit each other.
    """
    one, ok = hypotheses.track(0), hypotheses.usable
    smoothing = "none" if settings.smoothing == "none" else "window"
    grid = ways(one, to_step_of(one, grid), smoothing)[0].grid
    least_s = max(settings.min_overlap * hypotheses.seconds, settings.min_seconds)
    # A coarser reference meets every so many estimates only, in as many ways.
    thin = round(grid.step_s / hypotheses.hop_s)
    found = [
        best_lags(
            hypotheses.enf_hz[:, way::thin],
            ok[way::thin],
            grid.freq_hz,
            np.isfinite(grid.freq_hz),
            min_pairs=max(3, math.ceil(least_s / grid.step_s)),
        )
        for way in range(thin)
    ]
    best = np.argmax([np.nan_to_num(f.correlation, nan=-np.inf) for f in found], axis=0)

    def of_best(values: Sequence[NDArray[Any]]) -> FloatArray:
        return np.asarray(np.stack(values)[best, np.arange(best.size)], np.float64)

    first_s = hypotheses.first_s + best * hypotheses.hop_s
    correlation = of_best([f.correlation for f in found])
    lag_s = (of_best([f.lag for f in found]) + 0.5) * grid.step_s - first_s
    return Tally(
        hypotheses=hypotheses,
        settings=settings,
        lag_s=np.where(np.isnan(correlation), np.nan, lag_s),
        correlation=correlation,
        offset_hz=of_best([f.offset for f in found]),
        seconds=of_best([f.pairs for f in found]) * grid.step_s,
        lags=sum(f.compared for f in found),
    )
