"""The propositions, and the likelihood ratios between them."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

from rsenf.match.evidence import MAX_VERBAL_LOG10, SCALE, verbal
from rsenf.messages import MatchResult
from rsenf.report.recording_time.case import Case
from rsenf.report.recording_time.texts import METHODS, RATIO_MEANING, SCALE_SOURCE
from rsenf.report.recording_time.words import place
from rsenf.report.verdict import number
from rsenf.timebase import seconds

_EVEN_LOG10 = SCALE[-1][0]  # below it the words are "no support either way"


def propositions(case: Case) -> dict[str, str]:
    """Return the three propositions by their short names."""
    result = case.result
    time = (
        f"The recording was begun {place(result)}: the best time in this reference."
        if math.isfinite(result.lag_s)
        else "The recording was begun at the best time in this reference. (None could be named.)"
    )
    return {
        "H1": time,
        "H2": "The recording was begun at another time that this reference covers.",
        "H3": "The recording was begun at a time that is not in this reference, or on another "
        "grid.",
    }


def claim_among(case: Case) -> str:
    """Say which proposition the claimed time belongs to; empty without a claim."""
    result = case.result
    reference = next((r for r in case.references if r.grid == result.grid), None)
    if not result.claimed_utc_ns or reference is None or not reference.t0_ns:
        return ""
    claimed_s = seconds(result.claimed_utc_ns - reference.t0_ns)
    if not 0 <= claimed_s <= reference.samples * reference.step_s:
        return "The claimed time lies outside this reference: it belongs to H3."
    if abs(claimed_s - result.lag_s) <= case.settings.tolerance_s:
        return "The claimed time is that of H1."
    return "The claimed time is another than that of H1: it belongs to H2."


def comparisons(result: MatchResult) -> list[dict[str, Any]]:
    """Return both ratios: H1 against H2, and H1 against H3."""
    return [_comparison("H2", result.log10_lr), _comparison("H3", result.log10_lr_absent)]


def ratio_texts(result: MatchResult) -> dict[str, Any]:
    """Return what must be said of ratios: their meaning, their making, the scale of words."""
    return {
        "meaning": list(RATIO_MEANING),
        "method": METHODS.get(result.method, ""),
        "limit": f"The words go no further than a ratio of {_power(MAX_VERBAL_LOG10)}: that is "
        "what the calibration on measured data can vouch for. A larger ratio is what the "
        "computation says, not more evidence.",
        "scale": _scale(),
        "scale_source": SCALE_SOURCE,
    }


def _comparison(other: str, log10_lr: float) -> dict[str, Any]:
    return {
        "for": "H1",
        "against": other,
        "log10_lr": number(log10_lr),
        "verbal": verbal(log10_lr) or "not computed",
        "sentence": _sentence(other, log10_lr),
    }


def _sentence(other: str, log10_lr: float) -> str:
    if not math.isfinite(log10_lr):
        return f"There is no ratio of H1 against {other}: too little could be compared."
    if abs(log10_lr) < _EVEN_LOG10:
        return f"What was measured is about as probable if H1 is true as if {other} is."
    first, second = ("H1", other) if log10_lr > 0 else (other, "H1")
    beyond = abs(log10_lr) > MAX_VERBAL_LOG10
    times = f"{'more than ' if beyond else 'about '}{_power(min(abs(log10_lr), MAX_VERBAL_LOG10))}"
    computed = f" Computed: 10^{abs(log10_lr):.1f}." if beyond else ""
    return (
        f"What was measured is {times} times as probable if {first} is true as if {second} "
        f"is.{computed}"
    )


def _power(log10: float) -> str:
    """Write a power of ten to two digits: 1.5 is 32, 3 is 1000."""
    value = 10**log10
    if value < 10:
        return f"{value:.1f}"
    digits = max(math.floor(log10) - 1, 0)
    return f"{round(value, -digits):,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _scale() -> list[dict[str, str]]:
    """Return the scale of words, the weakest first."""
    limits = [_power(limit) for limit, _ in reversed(SCALE)]
    ratios = [f"below {limits[0]}", *map(" to ".join, pairwise(limits)), f"above {limits[-1]}"]
    words = ["no support either way", *(text for _, text in reversed(SCALE))]
    return [{"ratio": r, "words": w} for r, w in zip(ratios, words, strict=True)]
