"""The score against lag, reduced to the resolution of a picture, and its plots.

One plot is of the whole search, one of the lags near the best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.match.correlate import LagScores
from rsenf.messages import MatchResult
from rsenf.messages.schema import FloatArray
from rsenf.report.panels import ALONG, CLAIM, GRID, INK, MARK, annotate, say_nothing
from rsenf.timebase import seconds

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


# Lower end of the axis, so that a few very bad scores don't compress all others.
LOWEST_PERCENTILE = 2.0


def draw_score(axes: Any, curve: ScoreCurve, t0_ns: int, result: MatchResult) -> None:
    """Draw the scores of the whole search, with the best time and the claimed one marked."""
    axes.set_title("How well each time of the reference fits")
    if curve.is_empty:
        say_nothing(axes, "nothing to compare")
        return
    place = _start_axis(axes, t0_ns, float(np.ptp(curve.lag_s)))
    x = place(curve.lag_s)
    axes.set_ylabel(_label(curve))
    axes.fill_between(x, curve.low, curve.high, color=GRID, alpha=0.25, lw=0)
    axes.plot(x, curve.high, color=GRID, lw=0.8)
    best = _best(curve, result)
    low = float(np.nanpercentile(curve.low, LOWEST_PERCENTILE))
    axes.set_ylim(low - 0.05 * (best - low), best + 0.2 * (best - low))
    axes.set_xlim(x[0], x[-1])
    _mark_claim(axes, place, curve.lag_s, t0_ns, result)
    axes.plot(place(result.lag_s), best, "o", color=MARK, ms=7)
    right = result.lag_s > curve.lag_s[0] + 0.7 * np.ptp(curve.lag_s)
    axes.annotate(
        f"best fit: {best:.4g}", (place(result.lag_s), best),
        (-8 if right else 8, 6), textcoords="offset points", ha="right" if right else "left",
        color=MARK, bbox={"boxstyle": "square,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.8},
    )  # fmt: skip


def draw_near(axes: Any, curve: ScoreCurve, t0_ns: int, result: MatchResult) -> None:
    """Draw every score near the best time, with its 95 % interval."""
    axes.set_title(f"How well each time fits, {NEAR_S:g} s before and after the best")
    if not np.isfinite(curve.near).any():
        say_nothing(axes, "nothing to compare")
        return
    place = _start_axis(axes, t0_ns, 2 * NEAR_S)
    axes.set_ylabel(_label(curve))
    if math.isfinite(result.lag_std_s):
        reach_s = 1.96 * result.lag_std_s
        axes.axvspan(
            float(place(result.lag_s - reach_s)), float(place(result.lag_s + reach_s)),
            color=MARK, alpha=0.25, lw=0, label=f"best time ± {reach_s:.2g} s (95 %)",
        )  # fmt: skip
    axes.axvline(float(place(result.lag_s)), color=MARK, lw=1.0)
    axes.plot(place(curve.near_lag_s), curve.near, ".-", color=INK, ms=3, lw=0.8)
    edges_s = np.array([result.lag_s - NEAR_S, result.lag_s + NEAR_S])
    edges = place(edges_s)
    axes.set_xlim(edges[0], edges[1])
    _mark_claim(axes, place, edges_s, t0_ns, result)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper left", frameon=False, fontsize="small")


def _best(curve: ScoreCurve, result: MatchResult) -> float:
    """Return the best score: the result's, interpolated between lags, or the curve's maximum."""
    if curve.name == "correlation" and math.isfinite(result.correlation):
        return result.correlation
    near = curve.near if np.isfinite(curve.near).any() else curve.high
    return float(np.nanmax(near))


def _label(curve: ScoreCurve) -> str:
    return f"{curve.name} ({curve.unit})" if curve.unit else curve.name


def _mark_claim(axes: Any, place: Any, lag_s: Any, t0_ns: int, result: MatchResult) -> None:
    """Draw the claimed start if it lies within the axis."""
    if not (t0_ns and result.claimed_utc_ns):
        return
    claimed_s = seconds(result.claimed_utc_ns - t0_ns)
    if lag_s[0] <= claimed_s <= lag_s[-1]:
        axes.axvline(float(place(claimed_s)), color=CLAIM, lw=1.2, ls="--", zorder=0.5)
        at = (float(place(claimed_s)), 0.0)
        annotate(axes, "claimed", at, (3, 4), CLAIM, xycoords=ALONG)


def _start_axis(axes: Any, t0_ns: int, span_s: float) -> Callable[[Any], Any]:
    """Label an axis of start times: in UTC if known, else as time into the reference.

    Return a function from lags (s) to coordinates of the axis.
    """
    if not t0_ns:
        unit_s, unit = (3600.0, "hours") if span_s > 7200.0 else (1.0, "seconds")
        axes.set_xlabel(f"start of the recording, {unit} into the reference")
        return lambda lag_s: np.asarray(lag_s, np.float64) / unit_s
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=3)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    axes.set_xlabel("start of the recording (UTC)")
    t0_days = t0_ns / 86400e9
    return lambda lag_s: t0_days + np.asarray(lag_s, np.float64) / 86400.0
