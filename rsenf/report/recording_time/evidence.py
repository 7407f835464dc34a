"""The weight of the evidence in sentences: propositions, likelihood ratios, conditions.

H1 is the best time, H2 another time in the reference, H3 a time outside it (or another grid), C a
claimed time. Ratios are limited to what the calibration supports, and to the verbal scale's limit.

References
----------
ENFSI Guideline for Evaluative Reporting in Forensic Science, 2015.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal

from typing_extensions import TypedDict  # Pydantic's, before Python 3.12

from rsenf.match.calibration import calibration
from rsenf.match.search import MAX_VERBAL_LOG10, SCALE, verbal
from rsenf.messages import MatchResult
from rsenf.report.recording_time.words import RATIOLESS, Basis, ReferenceFacts, place, scope, when
from rsenf.report.values import number, texts
from rsenf.report.verdict import CALIBRATED, ratio_limits
from rsenf.timebase import nanoseconds, seconds

Comparison = TypedDict(
    "Comparison",
    {"for": str, "against": str, "log10_lr": float | None, "verbal": str, "sentence": str},
)


class RatioTexts(TypedDict):
    """Explanations of likelihood ratios, and the verbal scale."""

    meaning: list[str]
    method: str
    limit: str
    scale: list[dict[str, str]]
    scale_source: str


_EVEN_LOG10 = SCALE[-1][0]  # below it the words are "no support either way"


def propositions(case: Basis) -> dict[str, str]:
    """Return the propositions by their short names; C only if a claim was evaluated."""
    result, where = case.result, scope(case)
    best = (
        f"The recording was begun {place(case)}: the best time in {where}."
        if math.isfinite(result.lag_s)
        else f"The recording was begun at the best time in {where}. (No such time could be named.)"
    )
    covers = "covers" if len(case.references) == 1 else "cover"
    texts = {
        "H1": best,
        "H2": f"The recording was begun at another time that {where} {covers}.",
        "H3": f"The recording was begun at a time that is not in {where}, or on another grid.",
    }
    if math.isfinite(result.claim_log10_lr):
        texts["C"] = (
            "The recording was begun at the claimed time, within "
            f"± {case.settings.tolerance_s:g} s."
        )
    return texts


def comparisons(result: MatchResult) -> list[Comparison]:
    """Return both likelihood ratios of the best time: H1 against H2, and H1 against H3."""
    limits = _limits(result.method)
    ratioless = result.method in RATIOLESS
    why = f"{result.method} gives none" if ratioless else "too little could be compared"
    return [
        _comparison("H1", "H2", result.log10_lr, limits["other"], why),
        _comparison("H1", "H3", result.log10_lr_absent, limits["absent"], why),
    ]


def claim_comparisons(result: MatchResult) -> list[Comparison]:
    """Return both likelihood ratios of a claimed time; none if the method doesn't compute them."""
    if not math.isfinite(result.claim_log10_lr):
        return []
    limit = _limits(result.method)["claim"]
    return [
        _comparison("C", "H2", result.claim_log10_lr_other, limit),
        _comparison("C", "H3", result.claim_log10_lr, limit),
    ]


def claim_among(case: Basis) -> str:
    """Return which proposition the claimed time belongs to; empty if there is none, or unknown."""
    result = case.result
    reference = next((r for r in case.references if r.grid == result.grid), None)
    known = reference is not None and reference.t0_ns and math.isfinite(result.lag_s)
    if reference is None or not known or not result.claimed_utc_ns:
        return ""
    claimed_s = seconds(result.claimed_utc_ns - reference.t0_ns)
    if abs(claimed_s - result.lag_s) <= case.settings.tolerance_s:
        return "The claimed time is that of H1."
    if not 0 <= claimed_s <= reference.samples * reference.step_s and len(case.references) == 1:
        return "The claimed time lies outside this reference: it belongs to H3."
    return "The claimed time is another than that of H1."


def ratio_texts(result: MatchResult) -> RatioTexts:
    """Return explanations of the ratios: meaning, method, limit and verbal scale."""
    limits = _limits(result.method)
    furthest = _power(max(limits["other"], limits["absent"]))
    if math.isfinite(result.claim_log10_lr):
        furthest += f" ({_power(limits['claim'])} for a claimed time)"
    fixed = texts("recording_time")
    ratioless = result.method in RATIOLESS
    method = fixed["methods"].get("metric" if ratioless else result.method, "")
    if result.method == CALIBRATED:
        method += f" That calibration: {calibration().made}."
    return {
        "meaning": fixed["ratio_meaning"],
        "method": method,
        "limit": f"The words go no further than a ratio of about {furthest}, as that is all that "
        "measured data can vouch for. Whatever a computation says beyond it is no more evidence.",
        "scale": _scale(),
        "scale_source": fixed["scale_source"],
    }


def _limits(method: str) -> dict[str, float]:
    """Return the log10 of the largest ratio to report, for each question."""
    return {name: min(limit, MAX_VERBAL_LOG10) for name, limit in ratio_limits(method).items()}


def _comparison(
    first: str, other: str, log10_lr: float, limit: float, why_none: str = ""
) -> Comparison:
    known = math.isfinite(log10_lr)
    none = f"There is no ratio of {first} against {other}: {why_none}."
    return {
        "for": first,
        "against": other,
        "log10_lr": number(log10_lr),
        "verbal": verbal(log10_lr) or "not computed",
        "sentence": _sentence(first, other, log10_lr, limit) if known else none,
    }


def _sentence(first: str, other: str, log10_lr: float, limit: float) -> str:
    if abs(log10_lr) < _EVEN_LOG10:
        return f"What was measured is about as probable if {first} is true as if {other} is."
    likelier, less = (first, other) if log10_lr > 0 else (other, first)
    size = abs(log10_lr)
    times = f"about {_power(size)} times" if size < limit else f"{_power(limit)} times or more"
    computed = f" (Computed: 10^{size:.1f}.)" if size > limit + 1e-9 else ""
    return (
        f"What was measured is {times} as probable if {likelier} is true as if {less} is.{computed}"
    )


def _power(log10: float) -> str:
    """Return a power of ten rounded to two digits: 1.5 gives 32, 3 gives 1000."""
    value = 10**log10
    if value < 9.95:
        return f"{value:.2g}"
    digits = max(math.floor(log10) - 1, 0)
    return f"{round(value, -digits):,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _scale() -> list[dict[str, str]]:
    """Return the verbal scale, the weakest first."""
    limits = [_power(limit) for limit, _ in reversed(SCALE)]
    ratios = [f"below {limits[0]}", *map(" to ".join, pairwise(limits)), f"above {limits[-1]}"]
    words = ["no support either way", *(text for _, text in reversed(SCALE))]
    return [{"ratio": r, "words": w} for r, w in zip(ratios, words, strict=True)]


def kind(case: Basis) -> tuple[Literal["investigative", "evaluative"], str]:
    """Return 'evaluative' or 'investigative', and the reason in words."""
    result, kinds = case.result, texts("recording_time")["kinds"]
    if not result.claimed_utc_ns:
        return "investigative", kinds["investigative"]
    if math.isfinite(result.claim_log10_lr):
        return "evaluative", kinds["evaluative"]
    return "investigative", kinds["unweighed"]


def conditions(case: Basis) -> list[str]:
    """Return, in sentences, the conditions under which the likelihood ratios hold."""
    result, names = case.result, ", ".join(propositions(case))
    fixed, settings = texts("recording_time")["conditions"], case.settings
    usable = sum(e.usable for e in case.estimates)
    sentences = [
        f"Propositions: the evidence is weighed given {names}, two at a time. It says nothing of "
        f"any other.{_searched(case)}",
        fixed["recording"].format(
            name=case.recording.name, usable=usable, values=len(case.estimates)
        ),
        *(_reference(r) for r in case.references),
        fixed["light"],
    ]
    if result.method not in RATIOLESS:
        reference_mhz = 1e3 * settings.reference_std_hz
        sentences.append(
            fixed["errors"].format(reference_mhz=reference_mhz, clock_ppm=settings.clock_scale_ppm)
        )
    if result.method == CALIBRATED:
        sentences.append(fixed["calibration"].format(made=calibration().made))
    return [*sentences, *fixed["rest"]]


def _searched(case: Basis) -> str:
    result = case.result
    found = (
        f" H1 is the best of {result.search_size} starts compared, and that many count against it."
        if result.search_size and result.method not in RATIOLESS
        else ""
    )
    if math.isfinite(result.claim_log10_lr):
        return f" C is the claimed start, {when(result.claimed_utc_ns)}.{found}"
    return found


def _reference(facts: ReferenceFacts) -> str:
    span_ns = nanoseconds(facts.samples * facts.step_s)
    stamps = (
        f"from {when(facts.t0_ns)} to {when(facts.t0_ns + span_ns)}, with these times right and in "
        "UTC"
        if facts.t0_ns
        else f"over {facts.samples * facts.step_s:g} s without times of day, one value every "
        f"{facts.step_s:g} s"
    )
    return f"Reference: {facts.name} is the frequency of the grid {facts.grid}, {stamps}."
