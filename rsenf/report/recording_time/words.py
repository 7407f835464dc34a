"""The inputs of a report on the time of a recording, its question and answer in plain sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.match.series import Grid
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate, IdleEstimate, MatchResult
from rsenf.report.picture import ThinRows
from rsenf.timebase import NO_ZONE, seconds, utc_text


@dataclass(frozen=True, kw_only=True)
class RecordingFacts:
    """The recording's file. ``seconds`` is the duration of what could be read.

    ``frame_rate_hz`` is measured from the frame times; ``container`` is the metadata of a video.
    """

    name: str
    bytes: int
    sha256: str
    seconds: float
    stretches: int
    frame_rate_hz: float | None = None
    container: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class ReferenceFacts:
    """A reference's file and its contents. ``bytes`` is None if it isn't a single file."""

    name: str
    bytes: int | None
    sha256: str
    grid: str
    nominal_hz: float
    t0_ns: int
    step_s: float
    samples: int
    valid_samples: int
    gaps: int
    longest_gap_s: float
    duplicates: int
    notes: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Basis:
    """A verdict and everything that it is based on.

    Parameters
    ----------
    result : MatchResult
    verdict : dict
        The verdict as ``verify --json`` prints it, including warnings.
    estimates : sequence of EnfEstimate
        Estimates of the epoch that the result is about.
    spectrum : ThinRows
        Spectrogram of the same epoch.
    grid : Grid or None
        The reference that the result is about.
    recording : RecordingFacts
    references : sequence of ReferenceFacts
        All references that were searched.
    settings : MatchSettings
    command : str
        Command line that reproduces the report; empty if it wasn't made by a command.
    parameters : mapping of str to mapping
        All parameters in effect, by group; without absolute paths.
    versions : mapping of str to str
        Versions of rsenf and of the libraries it uses.
    idle : IdleEstimate, optional
        The camera's idle ratio, if it was estimated.
    """

    result: MatchResult
    verdict: dict[str, Any]
    estimates: Sequence[EnfEstimate]
    spectrum: ThinRows
    grid: Grid | None
    recording: RecordingFacts
    references: Sequence[ReferenceFacts]
    settings: MatchSettings = field(default_factory=MatchSettings)
    command: str = ""
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    idle: IdleEstimate | None = None


def when(t_ns: int) -> str:
    """Return a time as text, to a hundredth of a second."""
    text = utc_text(t_ns)
    return f"{text[:10]} {text[11:22]} UTC" if text else "an unknown time"


def scope(case: Basis) -> str:
    """Return a name for what was searched."""
    return "this reference" if len(case.references) == 1 else "these references"


def place(case: Basis) -> str:
    """Return the best time and its 95 % interval as text."""
    result = case.result
    reach_s = 1.96 * result.lag_std_s
    interval = f" (± {reach_s:.2f} s, 95 % interval)" if math.isfinite(reach_s) else ""
    on = f" on the grid {result.grid}" if len(case.references) > 1 else ""
    if result.start_utc_ns:
        zone = f", {NO_ZONE}" if result.zone_unknown else ""
        return f"at {when(result.start_utc_ns)}{interval}{on}{zone}"
    return f"{result.lag_s:.2f} s after the start of the reference{interval}{on}"


def question(case: Basis) -> str:
    """Return the question that the report answers."""
    claimed_ns = case.result.claimed_utc_ns
    if claimed_ns:
        return f"Did the recording {case.recording.name} begin at {when(claimed_ns)}, as claimed?"
    return f"When was the recording {case.recording.name} made?"


def answer(case: Basis) -> str:
    """Return the answer in one or two sentences."""
    result = case.result
    if result.claim == "supported":
        return _supported(case)
    if result.claim == "refuted":
        return _refuted(case)
    if result.decision == "match":
        untested = "The claim can't be tested, though one time fits"
        return f"{untested if result.claim else 'One time fits'}: {_fits(case)}"
    if result.decision == "no_match" and not result.claim:
        return f"The recording fits the grid's frequency at no time in {scope(case)}."
    return f"This can't be decided from the recording and {scope(case)}: {result.reason}."


def _fits(case: Basis) -> str:
    """Return what a match means, as a clause."""
    if case.result.method in RATIOLESS:
        return (
            f"the recording passes the threshold of {case.result.method} {place(case)}. Wrong "
            "times may pass it too: how much this weighs is not known."
        )
    return (
        f"the recording fits the grid's frequency {place(case)}, and no other time in "
        f"{scope(case)} fits nearly as well."
    )


def _supported(case: Basis) -> str:
    if case.result.decision == "match":
        return f"Yes, the claim is supported: {_fits(case)}"
    return (
        "Yes, the claim is supported: the recording fits the grid's frequency at the claimed time. "
        f"Without the claim it could not have been settled: {case.result.reason}."
    )


def _refuted(case: Basis) -> str:
    result = case.result
    misfit = "the recording does not fit the grid's frequency at the claimed time"
    if result.decision == "match":
        away = distance(result.claimed_utc_ns, result.start_utc_ns)
        fits = _fits(case).replace("the recording", "it", 1)
        return f"No, the claim is refuted: {misfit}. Instead, {away} the claim, {fits}"
    if result.decision == "no_match":
        return f"No, the claim is refuted: {misfit}, nor at any other time in {scope(case)}."
    return (
        f"No, the claim is refuted: {misfit}. When it was made instead can't be said: "
        f"{result.reason}."
    )


def distance(from_ns: int, to_ns: int) -> str:
    """Return how long one time is after or before another, to be continued by 'the claim'.

    >>> distance(0, 90_500_000_000)
    '90.5 s after'
    """
    away_s = seconds(to_ns - from_ns)
    size_s = abs(away_s)
    side = "after" if away_s > 0 else "before"
    if size_s < 120:
        return f"{size_s:.1f} s {side}"
    if size_s < 48 * 3600:
        hours, rest_s = divmod(round(size_s), 3600)
        return f"{hours} h {rest_s // 60} min {rest_s % 60} s {side}"
    return f"{size_s / 86400:.1f} days {side}"


# The paper's metrics decide by a threshold, and have no likelihood ratio.
RATIOLESS = frozenset(f"metric{number}" for number in (1, 2, 3, 4))
