"""Statistics of every benchmark: groups of rows, means and medians, bounds of rates, origins."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record

Row = dict[str, Any]
Statistic = Callable[[Sequence[float]], float | None]
CONFIDENCE = 0.95


def grouped(rows: Iterable[Row], *by: str) -> list[tuple[Row, list[Row]]]:
    """Return the rows with equal values of some fields, after these values, in order.

    >>> grouped([{"a": 1, "b": 2}, {"a": 1, "b": 3}], "a")
    [({'a': 1}, [{'a': 1, 'b': 2}, {'a': 1, 'b': 3}])]
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    return [(dict(zip(by, key, strict=True)), found) for key, found in groups.items()]


def _or_none(statistic: Callable[[Sequence[float]], Any]) -> Statistic:
    """Return a statistic that is None of no values."""
    return lambda values: float(statistic(values)) if len(values) else None


median, mean, worst = _or_none(np.median), _or_none(np.mean), _or_none(np.max)
rms = _or_none(lambda values: np.sqrt(np.mean(np.square(values))))


def rate_bound(events: int, trials: int) -> float:
    """Return the one-sided 95 % upper bound of a binomial rate (Clopper and Pearson 1934).

    >>> round(rate_bound(0, 300), 4)
    0.0099
    """
    from scipy.stats import binomtest

    if events >= trials:
        return 1.0
    return float(binomtest(events, trials, alternative="less").proportion_ci(CONFIDENCE).high)


def count_bound(events: int) -> float:
    """Return the one-sided 95 % upper bound of a Poisson mean (Garwood 1936)."""
    from scipy.special import gammaincinv

    return float(gammaincinv(events + 1, CONFIDENCE))


def rate_interval(events: int, trials: int) -> tuple[float, float]:
    """Return the two-sided 95 % interval of a binomial rate (Clopper and Pearson 1934).

    Parameters
    ----------
    events, trials : int
    """
    from scipy.stats import binomtest

    interval = binomtest(events, trials).proportion_ci(CONFIDENCE)
    return float(interval.low), float(interval.high)


def origin_of(records: Sequence[Record]) -> Row:
    """Return the seeds and grids of records, and the versions of the program that made them."""
    return {
        "seeds": sorted({r["seed"] for r in records}),
        "grids": sorted({r["grid"] for r in records if "grid" in r}),
        "versions": [dict(v) for v in sorted({tuple(r["versions"].items()) for r in records})],
    }
