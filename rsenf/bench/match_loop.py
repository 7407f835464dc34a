"""A clip compared with a reference lag by lag in a plain loop: what a search is measured beside."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from rsenf.match.ncc import Residuals
from rsenf.messages.schema import FloatArray

RUNS, RUN = 20, 1000  # of lags in a row that stand for all of a long reference


def lag_by_lag(
    clip_hz: FloatArray, reference_hz: FloatArray, first: int, count: int, least: int
) -> Residuals:
    """Do what :func:`rsenf.match.ncc.lag_residuals` does, for some lags in a row.

    Parameters
    ----------
    clip_hz, reference_hz : ndarray, shapes (n,) and (N,)
        On one step, NaN in gaps.
    first, count : int
        Lags, which the two may overlap at in part.
    least : int
        Pairs below which a lag isn't compared.
    """
    pairs = np.zeros(count, np.int64)
    offset, var = np.full((2, count), np.nan)
    for k, lag in enumerate(range(first, first + count)):
        a, b = max(-lag, 0), min(clip_hz.size, reference_hz.size - lag)
        apart = clip_hz[a:b] - reference_hz[a + lag : b + lag]
        apart = apart[np.isfinite(apart)]
        pairs[k] = apart.size
        if apart.size >= least:
            offset[k], var[k] = apart.mean(), apart.var()
    return Residuals(first, pairs, offset, var)


def drawn_parts(reference_hz: FloatArray, clip: int, seed: int) -> list[FloatArray]:
    """Draw parts of a reference, in each of which a clip has :data:`RUN` lags."""
    rng = np.random.default_rng([seed, 3])
    starts = np.sort(rng.integers(0, reference_hz.size - RUN - clip, RUNS))
    return [np.asarray(reference_hz[a : a + RUN + clip]) for a in starts]


def loop_cpu_s(clip_hz: FloatArray, parts: Sequence[FloatArray], lags: int, least: int) -> float:
    """Processor time that the loop would take for so many lags, by those of some parts."""
    began_s = time.process_time()
    for part in parts:
        lag_by_lag(clip_hz, part, 0, RUN, least)
    return (time.process_time() - began_s) * lags / (RUN * len(parts))
