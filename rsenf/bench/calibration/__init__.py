"""Calibration of the matcher's likelihood ratios, on searches of real grids with a known answer.

Here: the line from raw to calibrated log10 likelihood ratios, its cost and its reliability. Then::

    searches     a simulated clip searched for in a reference with its time, and in one without
    real_clips   luminance of a real camera, degraded and tracked
    table        counts of decisions, reliability, and their picture
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.statistics import rate_interval
from rsenf.match.calibration import CalibrationLine
from rsenf.messages.schema import FloatArray

QUESTIONS = ("other", "absent", "claim")
RULE_OF_THREE = 3.0
# Raw ratios are limited to it, so that certain cases don't dominate the fit.
FARTHEST = 12.0
EDGES = (-math.inf, -2.0, -1.0, 0.0, 1.0, 2.0, math.inf)
LN10 = math.log(10.0)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Raw log10 likelihood ratios of cases in which a proposition is true, and of others."""

    held: FloatArray  # where it is true
    failed: FloatArray
    even: bool = True  # both kinds have equal weight in all, whatever their numbers

    @property
    def weights(self) -> tuple[float, float]:
        """Weight of a case of each kind; the sum over all cases is 1."""
        if self.even:
            return 0.5 / max(self.held.size, 1), 0.5 / max(self.failed.size, 1)
        each = 1.0 / max(self.held.size + self.failed.size, 1)
        return each, each

    @property
    def vouched(self) -> float:
        """Log10 of the largest ratio that the number of cases supports: the rule of three."""
        cases = self.failed.size + (0 if self.even else self.held.size)
        return math.log10(max(cases, 1) / RULE_OF_THREE)


def pairs_of(records: Sequence[Record], question: str) -> Pairs:
    """Return the cases of a question.

    ``absent``: the best time is the true one, or the true one isn't in the reference. ``claim``: a
    claimed time is the true one, or isn't. ``other``: the true time is in the reference, and is the
    best one, or isn't; that ratio includes the size of the search, so the kinds aren't reweighted.

    Parameters
    ----------
    records : sequence of dict
        Of searches.
    """
    usable = [r for r in records if r["usable"]]
    present = [r["present"] for r in usable if r["present"]]
    if question == "claim":
        held = [r["true_claim"] for r in usable]
        failed = [claim for r in usable for claim in r["false_claims"]]
    else:
        held = [p[question] for p in present if p["right"]]
        failed = [p["other"] for p in present if not p["right"]]
    if question == "absent":
        searches = [r[case] for r in usable for case in ("absent", "absent_day") if r.get(case)]
        failed = [found["absent"] for found in searches]
    yes, no = (np.array([v for v in part if v is not None], float) for part in (held, failed))
    return Pairs(yes, no, question != "other")


def fitted(pairs: Pairs) -> CalibrationLine:
    """Fit the line by logistic regression, with a slope of at most 1."""
    from scipy.optimize import minimize

    sides = [np.clip(side, -FARTHEST, FARTHEST) for side in (pairs.held, pairs.failed)]

    def cost(line: FloatArray) -> float:
        return _cost(pairs, *(line[0] * side + line[1] for side in sides))

    found = minimize(cost, [1.0, 0.0], bounds=[(0.05, 1.0), (-3.0, 3.0)])
    slope, intercept = (round(float(value), 4) for value in found.x)
    return CalibrationLine(slope, intercept, round(pairs.vouched, 2))


def cost_of_ratios(pairs: Pairs, line: CalibrationLine) -> float:
    """Return Cllr, the mean cost of the ratios in bits (Brümmer and du Preez 2006)."""
    return _cost(pairs, *(_ratios(side, line) for side in (pairs.held, pairs.failed))) / math.log(2)


def _cost(pairs: Pairs, held: FloatArray, failed: FloatArray) -> float:
    """Return the mean cost of ratios, in nats."""
    of_held, of_failed = pairs.weights
    cost = of_held * np.logaddexp(0, -LN10 * held).sum()
    return float(cost + of_failed * np.logaddexp(0, LN10 * failed).sum())


def _ratios(raw: FloatArray, line: CalibrationLine) -> FloatArray:
    return np.array([line(float(value)) for value in raw])


def reliability(pairs: Pairs, line: CalibrationLine) -> list[dict[str, Any]]:
    """Return the share of true propositions by calibrated ratio.

    ``said`` is the share expected from the ratios, ``came`` the observed one, ``low`` to ``high``
    its 95 % interval; all by the weights of the two kinds.
    """
    held, failed = _ratios(pairs.held, line), _ratios(pairs.failed, line)
    of_held, of_failed = pairs.weights
    out = []
    for low, high in pairwise(EDGES):
        yes, no = held[(held >= low) & (held < high)], failed[(failed >= low) & (failed < high)]
        if not yes.size + no.size:
            continue
        means = 1 / (1 + np.exp(-LN10 * np.concatenate([yes, no])))
        weights = np.repeat([of_held, of_failed], [yes.size, no.size])
        shares = (yes.size / (yes.size + no.size), *rate_interval(yes.size, yes.size + no.size))
        came, least, most = (s * of_held / (s * of_held + (1 - s) * of_failed) for s in shares)
        ends = (end if math.isfinite(end) else None for end in (low, high))
        out.append({
            **dict(zip(("from_log10_lr", "to_log10_lr"), ends, strict=True)),
            "held": int(yes.size), "failed": int(no.size),
            "said": float(np.average(means, weights=weights)),
            "came": came, "low": least, "high": most,
        })  # fmt: skip
    return out
