"""Plots of the score against start time: of the whole search, and near the best."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rsenf.messages import MatchResult
from rsenf.report.panels import CLAIM, GRID, INK, MARK, say_nothing, start_axis
from rsenf.report.score_curve import NEAR_S, ScoreCurve
from rsenf.timebase import seconds

# Lower end of the axis, so that a few very bad scores don't compress all others.
LOWEST_PERCENTILE = 2.0


def draw_score(axes: Any, curve: ScoreCurve, t0_ns: int, result: MatchResult) -> None:
    """Draw the scores of the whole search, with the best time and the claimed one marked.

    Parameters
    ----------
    axes : matplotlib axes
    curve : ScoreCurve
    t0_ns : int
        Start of the reference, UTC since 1970; 0 if unknown.
    result : MatchResult
    """
    axes.set_title("How well each time of the reference fits")
    if curve.is_empty:
        say_nothing(axes, "nothing to compare")
        return
    place = start_axis(axes, t0_ns, float(np.ptp(curve.lag_s)))
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
    """Draw every score near the best time, with its 95 % interval.

    Parameters as for :func:`draw_score`.
    """
    axes.set_title(f"How well each time fits, {NEAR_S:g} s before and after the best")
    if not np.isfinite(curve.near).any():
        say_nothing(axes, "nothing to compare")
        return
    place = start_axis(axes, t0_ns, 2 * NEAR_S)
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
        axes.annotate(
            "claimed", (float(place(claimed_s)), 0.0), (3, 4), xycoords=("data", "axes fraction"),
            textcoords="offset points", color=CLAIM, fontsize="small",
        )  # fmt: skip
