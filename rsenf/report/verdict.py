"""Verdicts on the time of recording, on liveness, and alarms, as JSON and text."""

from __future__ import annotations

import math
from typing import Any

from typing_extensions import TypedDict  # Pydantic's, before Python 3.12

from rsenf.match.calibration import calibration
from rsenf.messages import Alarm, Candidate, Edit, Liveness, MatchResult, Segment
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


def number(value: float) -> float | None:
    """Return a float for JSON: None if it isn't finite."""
    return float(value) if math.isfinite(value) else None


def ppm_text(value: float) -> str:
    """Return parts per million with sign and one decimal; zero is +0.0.

    >>> ppm_text(-0.04), ppm_text(68.25)
    ('+0.0', '+68.2')
    """
    return f"{round(value, 1) + 0.0:+.1f}"


def verdict_json(result: MatchResult, warnings: list[str]) -> dict[str, Any]:
    """Return the JSON document of a verdict; its keys are stable.

    Parameters
    ----------
    result : MatchResult
        The verdict.
    warnings : list of str
        All warnings that a reader should know, including the result's own.
    """
    return {
        "decision": result.decision,
        "grid": result.grid,
        "reason": result.reason,
        "lag_s": number(result.lag_s),
        "lag_std_s": number(result.lag_std_s),
        "start_utc": utc_text(result.start_utc_ns),
        "correlation": number(result.correlation),
        "log10_lr": number(result.log10_lr),
        "log10_lr_absent": number(result.log10_lr_absent),
        "claim": result.claim or None,
        "claim_log10_lr": number(result.claim_log10_lr),
        "claim_log10_lr_other": number(result.claim_log10_lr_other),
        "verbal": result.verbal,
        "clock_ppm": number(result.clock_ppm),
        "clock_std_ppm": number(result.clock_std_ppm),
        "residual_std_hz": number(result.residual_std_hz),
        "expected_std_hz": number(result.expected_std_hz),
        "search_size": result.search_size,
        "seconds_used": result.seconds_used,
        "idle_ratio": number(result.idle_ratio),
        "method": result.method,
        "zone_unknown": result.zone_unknown,
        "candidates": [_candidate_json(c) for c in result.candidates],
        "segments": [_segment_json(segment) for segment in result.segments],
        "edits": [_edit_json(edit) for edit in result.edits],
        "warnings": warnings,
    }


def _segment_json(segment: Segment) -> SegmentJson:
    return {
        "from_s": number(segment.from_s),
        "to_s": number(segment.to_s),
        "grid": segment.grid,
        "lag_s": number(segment.lag_s),
        "lag_std_s": number(segment.lag_std_s),
        "start_utc": utc_text(segment.start_utc_ns),
        "log10_lr": number(segment.log10_lr),
    }


def _edit_json(edit: Edit) -> EditJson:
    return {
        "kind": edit.kind,
        "at_s": number(edit.at_s),
        "at_std_s": number(edit.at_std_s),
        "size_s": number(edit.size_s),
        "size_std_s": number(edit.size_std_s),
        "speed_ratio": number(edit.speed_ratio),
        "speed_ratio_std": number(edit.speed_ratio_std),
        "text": edit.text,
    }


def _candidate_json(candidate: Candidate) -> CandidateJson:
    return {
        "grid": candidate.grid,
        "lag_s": number(candidate.lag_s),
        "start_utc": utc_text(candidate.start_utc_ns),
        "correlation": number(candidate.correlation),
        "clock_ppm": number(candidate.clock_ppm),
        "log10_lr": number(candidate.log10_lr),
        "seconds_used": candidate.seconds_used,
    }


def verdict_words(result: MatchResult) -> str:
    """Return a verdict as a few lines of text."""
    lines = [headline(result)]
    details = _details(result) if math.isfinite(result.lag_s) else []
    edits = [("edited?", edit.text) for edit in result.edits]
    if result.decision != "match" and result.segments:
        details = [*_segments(result), *edits, ("what may help", UNEDITED)]
    else:
        details += edits
    lines += [f"  {name:15} {text}" for name, text in details]
    if result.claim:
        lines.append(f"  {'claimed start':15} {utc_text(result.claimed_utc_ns)}: {result.claim}")
    return "\n".join(lines)


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
    error = f" ± {result.lag_std_s:.2f}" if math.isfinite(result.lag_std_s) else ""
    place = f"{result.lag_s:.2f}{error} s into the reference"
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
        std = result.clock_std_ppm
        error = f" ± {std:.1f}" if math.isfinite(std) else ""
        clock = f"{ppm_text(result.clock_ppm)}{error} ppm (12 ppm is a second a day)"
        details.append(("camera's clock", clock))
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


def live_json(liveness: Liveness) -> dict[str, Any]:
    """Return the JSON document of a verdict on liveness; None for what is unknown."""
    return {
        "t_s": seconds(liveness.header.pts_ns),
        "epoch": liveness.header.epoch,
        "verdict": liveness.verdict,
        "since_utc": utc_text(liveness.since_ns),
        "lag_s": number(liveness.lag_s),
        "lag_std_s": number(liveness.lag_std_s),
        "clock_ppm": number(liveness.clock_ppm),
        "clock_std_ppm": number(liveness.clock_std_ppm),
        "log10_lr": number(liveness.log10_lr),
        "origin_utc": utc_text(liveness.origin_utc_ns),
        "evidence": liveness.evidence,
    }


def alarm_json(alarm: Alarm) -> dict[str, Any]:
    """Return the JSON document of an alarm, or of its end."""
    return {
        "start_s": seconds(alarm.start_pts_ns),
        "end_s": None if alarm.active else seconds(alarm.end_pts_ns),
        "epoch": alarm.header.epoch,
        "kind": alarm.kind,
        "severity": alarm.severity,
        "active": alarm.active,
        "value": number(alarm.value),
        "limit": number(alarm.limit),
        "unit": alarm.unit,
        "text": alarm.text,
    }
