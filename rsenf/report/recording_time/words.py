"""The question, the answer and the claim, each in a plain sentence."""

from __future__ import annotations

import math

from rsenf.messages import MatchResult
from rsenf.report.verdict import utc_text
from rsenf.timebase import seconds

CLAIMS = {
    "supported": "The recording fits the reference at the claimed time, and at no other time "
    "nearly as well. How much that weighs is what the likelihood ratios say.",
    "refuted": "The recording does not fit the reference at the claimed time, or fits it clearly "
    "better at another. This supposes that neither of the two was altered.",
    "undecidable": "What was measured speaks neither clearly for the claimed time nor clearly "
    "against it. That is no sign that the claim is wrong.",
}


def when(t_ns: int) -> str:
    """Write a time for a person, to a hundredth of a second."""
    text = utc_text(t_ns)
    return f"{text[:10]} {text[11:22]} UTC" if text else "an unknown time"


def place(result: MatchResult) -> str:
    """Write the best time and its 95 % interval."""
    reach_s = 1.96 * result.lag_std_s
    interval = f" (± {reach_s:.2f} s, 95 % interval)" if math.isfinite(reach_s) else ""
    if result.start_utc_ns:
        return f"at {when(result.start_utc_ns)}{interval}"
    return f"{result.lag_s:.2f} s after the start of the reference{interval}"


def question(name: str, result: MatchResult) -> str:
    """Return what is asked of the recording of that name."""
    if result.claimed_utc_ns:
        return f"Did the recording {name} begin at {when(result.claimed_utc_ns)}, as claimed?"
    return f"When was the recording {name} made?"


def answer(result: MatchResult) -> str:
    """Return the answer in one sentence."""
    found = {"match": _match, "no_match": _no_match}.get(result.decision, _no_decision)
    return found(result)


def _match(result: MatchResult) -> str:
    only = "and no other time in this reference fits nearly as well"
    if result.claim == "refuted":
        away = distance(result.claimed_utc_ns, result.start_utc_ns)
        return (
            f"No, the claim is refuted: the recording fits the grid's frequency {place(result)}, "
            f"{away} the time claimed, {only}."
        )
    fits = f"the recording fits the grid's frequency {place(result)}, {only}."
    if result.claim == "supported":
        return f"Yes, the claim is supported: {fits}"
    if result.claim:
        return f"The claim can't be tested, though one time fits: {fits}"
    return f"One time fits: {fits}"


def _no_match(result: MatchResult) -> str:
    if result.claim == "refuted":
        return (
            "No, the claim is refuted: the recording does not fit the grid's frequency at the "
            "claimed time, nor at any other time in this reference."
        )
    start = "The claim can't be decided" if result.claim else "At no time in this reference"
    return f"{start}: {result.reason}."


def _no_decision(result: MatchResult) -> str:
    if result.claim == "refuted":
        return (
            "No, the claim is refuted: the recording does not fit the grid's frequency at the "
            f"claimed time. When it was made instead can't be said: {result.reason}."
        )
    return f"This can't be decided from the recording and this reference: {result.reason}."


def distance(from_ns: int, to_ns: int) -> str:
    """Say how far one time is after or before another, ready for 'the time …'."""
    away_s = seconds(to_ns - from_ns)
    size_s = abs(away_s)
    side = "after" if away_s > 0 else "before"
    if size_s < 120:
        return f"{size_s:.1f} s {side}"
    if size_s < 48 * 3600:
        hours, rest_s = divmod(round(size_s), 3600)
        return f"{hours} h {rest_s // 60} min {rest_s % 60} s {side}"
    return f"{size_s / 86400:.1f} days {side}"
