"""Verdicts on time, liveness, and alarms, as JSON and text.

On the time of a recording by a reference; of recordings by each other; of a stream.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from typing_extensions import TypedDict  # Pydantic's, before Python 3.12

from rsenf.match.against import Against, Aligned
from rsenf.match.calibration import calibration
from rsenf.messages import Alarm, Liveness, MatchResult
from rsenf.report.values import error_text, fields_json, lines_text, number, ppm_text
from rsenf.timebase import NO_ZONE, seconds, utc_text

UNEDITED = "the recording as the camera wrote it, before anything was done to it"
CALIBRATED = "phase"  # the method whose likelihood ratios are calibrated


class CandidateJson(TypedDict):
    """A possible start of the recording."""

    grid: str
    lag_s: float | None
    start_utc: str | None
    correlation: float | None
    clock_ppm: float | None
    log10_lr: float | None
    seconds_used: float


class SegmentJson(TypedDict):
    """A segment of an edited recording that fits the reference by itself."""

    from_s: float | None
    to_s: float | None
    grid: str
    lag_s: float | None
    lag_std_s: float | None
    start_utc: str | None
    log10_lr: float | None


class EditJson(TypedDict):
    """An edit of a recording, at one place or of its whole speed."""

    kind: str
    at_s: float | None
    at_std_s: float | None
    size_s: float | None
    size_std_s: float | None
    speed_ratio: float | None
    speed_ratio_std: float | None
    text: str


VERDICT = (
    "decision", "grid", "reason", "lag_s", "lag_std_s", "start_utc", "correlation", "log10_lr",
    "log10_lr_absent", "claim", "claim_log10_lr", "claim_log10_lr_other", "verbal", "clock_ppm",
    "clock_std_ppm", "residual_std_hz", "expected_std_hz", "search_size", "seconds_used",
    "idle_ratio", "method", "zone_unknown",
)  # fmt: skip


def verdict_json(result: MatchResult, warnings: Sequence[str] | None = None) -> dict[str, Any]:
    """Return the JSON document of a verdict; its keys are stable.

    Parameters
    ----------
    result : MatchResult
        The verdict.
    warnings : sequence of str, optional
        All warnings that a reader should know, including the result's own; by default only those.
    """
    return fields_json(result, VERDICT) | {
        "claim": result.claim or None,
        "candidates": [fields_json(c, CandidateJson.__annotations__) for c in result.candidates],
        "segments": [fields_json(s, SegmentJson.__annotations__) for s in result.segments],
        "edits": [fields_json(e, EditJson.__annotations__) for e in result.edits],
        "warnings": list(result.warnings if warnings is None else warnings),
    }


def verdict_words(result: MatchResult) -> str:
    """Return a verdict as a few lines of text."""
    details = _details(result) if math.isfinite(result.lag_s) else []
    edits = [("edited?", edit.text) for edit in result.edits]
    if result.decision != "match" and result.segments:
        details = [*_segments(result), *edits, ("what may help", UNEDITED)]
    else:
        details += edits
    if result.claim:
        details.append(("claimed start", f"{utc_text(result.claimed_utc_ns)}: {result.claim}"))
    return lines_text(headline(result), details)


def _segments(result: MatchResult) -> list[tuple[str, str]]:
    """Return the start of each segment of an edited clip, as pairs of a name and a line."""
    limit = ratio_limits(result.method)["absent"]
    return [
        (
            f"{one.from_s:.0f} to {one.to_s:.0f} s",
            f"from {utc_text(one.start_utc_ns) or f'{one.lag_s:.2f} s into the reference'} "
            f"(± {one.lag_std_s:.2f} s); another time is "
            f"{_less_likely(one.log10_lr, limit)}",
        )
        for one in result.segments
    ]


def headline(result: MatchResult) -> str:
    """Return a verdict as one line of text."""
    if result.decision == "match":
        zone = f"; {NO_ZONE}" if result.zone_unknown else ""
        return f"match: the recording begins {_when(result)}{zone}"
    return f"{result.decision}: {result.reason}"


def _when(result: MatchResult) -> str:
    place = f"{result.lag_s:.2f}{error_text(result.lag_std_s, '.2f')} s into the reference"
    utc = utc_text(result.start_utc_ns)
    return f"{utc}, {place}" if utc else place


def _details(result: MatchResult) -> list[tuple[str, str]]:
    """Return the basis of the verdict, as pairs of a name and a line."""
    matches, limits = result.decision == "match", ratio_limits(result.method)
    absent = result.decision == "no_match"
    details = [] if matches else [("nearest" if absent else "best fit", _when(result))]
    details.append((
        "how well",
        f"correlation {result.correlation:.4f} (1 is perfect) over {result.seconds_used:.0f} s "
        "of usable signal",
    ))  # fmt: skip
    if math.isfinite(result.idle_ratio):
        details.append(("idle period", f"taken for {result.idle_ratio:.0%} of a frame's time"))
    if absent:
        details.append(("other times", f"{result.search_size} compared, of which none fits"))
    elif math.isfinite(result.log10_lr):
        others = "the next best is" if result.log10_lr >= 0 else "together the others are"
        details.append((
            "other times",
            f"{result.search_size} compared; {others} "
            f"{_less_likely(result.log10_lr, limits['other'])}",
        ))  # fmt: skip
    if math.isfinite(result.log10_lr_absent):
        details.append((
            "elsewhere",
            "a time outside this reference is "
            f"{_less_likely(result.log10_lr_absent, limits['absent'])}",
        ))  # fmt: skip
    if result.verbal:
        details.append(("in all", result.verbal))
    if matches and math.isfinite(result.clock_ppm):
        clock = f"{ppm_text(result.clock_ppm)}{error_text(result.clock_std_ppm, '.1f')} ppm"
        details.append(("camera's clock", f"{clock} (12 ppm is a second a day)"))
    elif result.decision == "no_decision":
        details.append(("what may help", "a longer recording, or a reference of fewer hours"))
    return details


def ratio_limits(method: str) -> dict[str, float]:
    """Return the largest log10 likelihood ratio that a method's calibration supports.

    Parameters
    ----------
    method : str
        Name of the matcher.

    Returns
    -------
    dict of str to float
        By question: against 'other' times, against 'absent' (not in the reference), for a 'claim'.
        Infinite for a method without calibration.
    """
    if method != CALIBRATED:
        return dict.fromkeys(("other", "absent", "claim"), math.inf)
    return {question: line.limit for question, line in calibration().lines.items()}


def _less_likely(log10_lr: float, limit: float) -> str:
    """Return a log10 likelihood ratio in words; 'over' if it reaches the calibration's limit."""
    size = abs(log10_lr)
    if size < 0.3:
        return "about as likely"
    times = f"{10**size:.0f}" if size < 3 else f"10^{size:.1f}"
    over = "over " if size >= limit else ""
    return f"{over}{times} times {'less' if log10_lr > 0 else 'more'} likely"


LIVENESS = (
    "lag_s", "lag_std_s", "clock_ppm", "clock_std_ppm", "log10_lr", "origin_utc", "evidence",
)  # fmt: skip


def live_json(liveness: Liveness) -> dict[str, Any]:
    """Return the JSON document of a verdict on liveness; None for what is unknown."""
    return {
        "t_s": seconds(liveness.header.pts_ns),
        "epoch": liveness.header.epoch,
        "verdict": liveness.verdict,
        "since_utc": utc_text(liveness.since_ns),
        **fields_json(liveness, LIVENESS),
    }


def alarm_json(alarm: Alarm) -> dict[str, Any]:
    """Return the JSON document of an alarm, or of its end."""
    return {
        "start_s": seconds(alarm.start_pts_ns),
        "end_s": None if alarm.active else seconds(alarm.end_pts_ns),
        "epoch": alarm.header.epoch,
        **fields_json(alarm, ("kind", "severity", "active", "value", "limit", "unit", "text")),
    }


MEANINGS = {
    "match": "made at the same time, in the light of one grid",
    "no_match": "not made at the same time, or not on one grid",
    "no_decision": "can't be told from these recordings",
}
NEXT = "longer recordings, or ones with more usable signal, may help"


def against_json(found: Against, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of a comparison of two recordings; its keys are stable."""
    return fields_json(found, Against.__annotations__) | {"warnings": warnings}


def against_words(found: Against) -> str:
    """Return a comparison of two recordings as a few lines of text."""
    details = [("because", found.reason)]
    if math.isfinite(found.offset_s):
        error = error_text(found.offset_std_s, ".2f")
        before = "after" if found.offset_s >= 0 else "before"
        name = "offset" if found.decision == "match" else "best fit"
        details += [
            (name, f"the first begins {abs(found.offset_s):.2f}{error} s {before} the second"),
            ("likelihood", f"for this offset 10^{found.log10_lr:+.1f} against different times, "
             f"10^{found.log10_lr_other:+.1f} against another offset"),
        ]  # fmt: skip
    if found.decision == "match":
        clock = f"{ppm_text(found.clock_ppm)} ± {found.clock_std_ppm:.1f} ppm"
        details += [("in all", found.verbal), ("clocks", f"the first is faster by {clock}")]
    elif found.decision == "no_decision":
        details.append(("what may help", NEXT))
    return lines_text(f"{found.decision}: {MEANINGS[found.decision]}", details)


MOST_MISFIT = 3.0  # largest deviation of pairs from the common alignment, in standard errors


def aligned_json(names: Sequence[str], found: Aligned, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of several recordings aligned in time; its keys are stable."""
    apart = [name for name, at in zip(names, found.begin_s, strict=True) if not math.isfinite(at)]
    fits = not found.misfit > MOST_MISFIT
    columns = (found.begin_s, found.begin_std_s, found.clock_ppm, found.clock_std_ppm)
    return {
        "decision": "match" if fits and not apart else "no_decision",
        "reason": f"not placed: {', '.join(apart)}" if apart else ALIGNED if fits else DIFFER,
        "recordings": [
            dict(zip(RECORDING, (name, *map(number, values)), strict=True))
            for name, *values in zip(names, *columns, strict=True)
        ],
        "pairs": [
            {"first": names[i], "second": names[k], **against_json(pair, [])}
            for (i, k), pair in found.pairs.items()
        ],
        "misfit": number(found.misfit),
        "warnings": warnings,
    }


RECORDING = ("recording", "begin_s", "begin_std_s", "clock_ppm", "clock_std_ppm")
ALIGNED = "every one fits the first, or one that does"
DIFFER = "the pairs contradict each other"


def aligned_words(doc: dict[str, Any]) -> str:
    """Return the document of :func:`aligned_json` as text."""
    details = []
    for at, one in enumerate(doc["recordings"]):
        begin_s = one["begin_s"]
        where = "begins at 0" if not at else "can't be placed"
        if at and begin_s is not None:
            where = (
                f"begins {abs(begin_s):.2f} ± {one['begin_std_s']:.2f} s "
                f"{'after' if begin_s >= 0 else 'before'} the first, its clock faster by "
                f"{ppm_text(one['clock_ppm'])} ± {one['clock_std_ppm']:.1f} ppm"
            )
        details.append((one["recording"], where))
    if doc["misfit"] is not None:
        agreement = f"of all pairs: {doc['misfit']:.1f} standard errors (rms)"
        details.append(("agreement", agreement))
    details += [
        ("pair", f"{pair['first']}, {pair['second']}: {pair['decision']}") for pair in doc["pairs"]
    ]
    return lines_text(f"{doc['decision']}: {doc['reason']}", details)
