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
class Case:
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


CLAIMS = {
    "supported": "The recording fits the reference at the claimed time. How much that weighs is "
    "what the likelihood ratios say.",
    "refuted": "The recording does not fit the reference at the claimed time, or fits it clearly "
    "better at another. This supposes that neither of the two was altered.",
    "undecidable": "What was measured speaks neither clearly for the claimed time nor clearly "
    "against it. That is no sign that the claim is wrong.",
}


def when(t_ns: int) -> str:
    """Return a time as text, to a hundredth of a second."""
    text = utc_text(t_ns)
    return f"{text[:10]} {text[11:22]} UTC" if text else "an unknown time"


def scope(case: Case) -> str:
    """Return a name for what was searched."""
    return "this reference" if len(case.references) == 1 else "these references"


def place(case: Case) -> str:
    """Return the best time and its 95 % interval as text."""
    result = case.result
    reach_s = 1.96 * result.lag_std_s
    interval = f" (± {reach_s:.2f} s, 95 % interval)" if math.isfinite(reach_s) else ""
    on = f" on the grid {result.grid}" if len(case.references) > 1 else ""
    if result.start_utc_ns:
        zone = f", {NO_ZONE}" if result.zone_unknown else ""
        return f"at {when(result.start_utc_ns)}{interval}{on}{zone}"
    return f"{result.lag_s:.2f} s after the start of the reference{interval}{on}"


def question(case: Case) -> str:
    """Return the question that the report answers."""
    claimed_ns = case.result.claimed_utc_ns
    if claimed_ns:
        return f"Did the recording {case.recording.name} begin at {when(claimed_ns)}, as claimed?"
    return f"When was the recording {case.recording.name} made?"


def answer(case: Case) -> str:
    """Return the answer in one or two sentences."""
    found = {
        "supported": _supported,
        "refuted": _refuted,
        "undecidable": _undecidable,
        "": _unclaimed,
    }
    return found[case.result.claim](case)


def _fits(case: Case) -> str:
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


def _unclaimed(case: Case) -> str:
    result = case.result
    if result.decision == "match":
        return f"One time fits: {_fits(case)}"
    if result.decision == "no_match":
        return f"The recording fits the grid's frequency at no time in {scope(case)}."
    return f"This can't be decided from the recording and {scope(case)}: {result.reason}."


def _supported(case: Case) -> str:
    if case.result.decision == "match":
        return f"Yes, the claim is supported: {_fits(case)}"
    return (
        "Yes, the claim is supported: the recording fits the grid's frequency at the claimed time. "
        f"Without the claim it could not have been settled: {case.result.reason}."
    )


def _refuted(case: Case) -> str:
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


def _undecidable(case: Case) -> str:
    result = case.result
    if result.decision == "match":
        return f"The claim can't be tested, though one time fits: {_fits(case)}"
    return f"This can't be decided from the recording and {scope(case)}: {result.reason}."


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


SCALE_SOURCE = "ENFSI Guideline for Evaluative Reporting in Forensic Science, 2015"

RATIO_MEANING = (
    "A likelihood ratio says how much better one proposition explains what was measured than the "
    "other does. It is the weight of this one piece of evidence.",
    "It is not the probability that the claim is true, nor that the recording was made at this "
    "time. That depends on everything else known of the case as well. rsenf knows nothing of it "
    "and assumes nothing about it (no prior): putting the two together is for the court.",
    "Each ratio compares just the two propositions that it names. Both suppose that the recording "
    "is one unedited piece and that the reference and its time stamps are right.",
)

# The paper's metrics decide by a threshold, and have no likelihood ratio.
RATIOLESS = frozenset(f"metric{number}" for number in (1, 2, 3, 4))
# How each method computes its ratios.
METHODS = {
    **dict.fromkeys(
        RATIOLESS,
        "The published metrics decide by a threshold on the correlation alone. Wrong times of a "
        "long reference pass it too, and no likelihood ratio belongs to what they decide.",
    ),
    "phase": (
        "Method phase: the phase of the flicker is compared with that of the reference, its "
        "frequency added up over time, at every start, with allowance for errors of the estimates, "
        "the reference and the camera's clock. The likelihood of the best time is set against that "
        "of all others together (H2) and against that of the same flicker under any grid whatever "
        "(H3); in both the size of the search counts against it. The ratios then go through a "
        "calibration on searches of measured grid data whose answer is known."
    ),
    "ncc": (
        "Method ncc: the recording's ENF is laid over the reference at every start. Against H2 "
        "the best time is set against the next best. Against H3 it is asked how often the best of "
        "as many wrong times would fit this well by chance, and whether the fit is as close as the "
        "estimates' own errors lead one to expect. These ratios are not calibrated."
    ),
}

LIMITS = (
    "Mains light is needed: lamps that flicker with the grid. Daylight, lamps with steady drivers, "
    "batteries and vehicles leave nothing to compare.",
    "The exposure must leave the flicker in: 1/100 s (1/120 s on a 60 Hz grid) and its multiples "
    "swallow it, and many cameras choose them by themselves.",
    "The result is only as good as the reference. A reference with wrong time stamps, or one in "
    "another time zone, gives a wrong time; a gap in it can't be searched.",
    "A grid's frequency is the same all over the grid, which may span many countries. A match "
    "says when and on which grid, never where in it.",
    "A time that the reference doesn't cover can't be found. That none fits says only that the "
    "recording was made elsewhere or at another time, or was changed.",
    "Short or quiet stretches of the grid look alike. The more times are searched, the longer a "
    "recording must be to tell them apart.",
    "Lossy coding wears the flicker down, each coding a little more. Below about 150 kbit/s at "
    "720p little may be left, and what is left may be changed.",
    "A recording of a screen or of a projection carries the flicker of the second room as well: it "
    "may be dated by the recapture, not by the scene.",
    "A clip that was cut and joined, slowed down or sped up does not follow the grid throughout. "
    "It may match by a part of it only, or not at all. Someone who has the reference could also "
    "add a flicker on purpose; this analysis doesn't test for that.",
    "The camera's own clock is allowed to be off as those of cameras are (mostly within 70 ppm). A "
    "clock much further off makes the true time look less likely.",
    "Where the frame rate divides the light's frequency (25 frames/s on a 50 Hz grid), flicker "
    "stands nearly still from frame to frame, is hard to tell from the scene, and its direction is "
    "not known.",
)

GLOSSARY = {
    "best time, best fit": "The start in the reference at which the recording's ENF fits best. "
    "There always is one; whether it means anything is what the likelihood ratios say.",
    "camera's clock error (ppm)": "How much faster the camera's clock runs than the grid's "
    "reference, in parts per million: 12 ppm is one second a day. Positive is fast.",
    "correlation": "How alike two curves are in shape: 1 is perfect, 0 is not at all, -1 is "
    "upside down.",
    "coverage": "The share of the reference that holds a value; the rest are gaps.",
    "ENF": "Electric network frequency: the frequency of the alternating current of a grid, near "
    "50 or 60 Hz. It wanders by some hundredths of a hertz, everywhere in the grid alike.",
    "flicker": "Lamps on the mains get brighter and darker twice in every period of the current, "
    "too fast for the eye.",
    "H1, H2, H3": "The propositions that are set against each other.",
    "idle ratio": "The share of each frame's time in which the camera reads no row. It belongs to "
    "the camera and its mode.",
    "lag": "The recording's start less the reference's start, in seconds.",
    "likelihood ratio (LR)": "How many times as probable the measurement is if one proposition is "
    "true as if the other is. log10 of it: 2 is a hundred times, 3 a thousand times.",
    "log-likelihood": "The logarithm of how probable the measurement is at a time; differences of "
    "it are logarithms of likelihood ratios.",
    "match, no_match, no_decision": "One time fits and no other nearly as well; no time fits; or "
    "the recording is too short, too quiet or too noisy to say.",
    "MCAP": "A file format for recorded streams of data.",
    "reference": "A log of the grid's frequency, with the time of each value.",
    "residual": "What is left of the recording's ENF when the reference's is taken off.",
    "rolling shutter": "A camera that reads its picture row by row, so that each row sees the "
    "light at its own moment.",
    "score": "The number that says how well a time fits; the larger, the better.",
    "SHA-256": "A fingerprint of a file: another file with the same one can't be made.",
    "signal over noise (dB)": "How far the flicker stands out of the noise; 10 dB more is ten "
    "times the power.",
    "spectrogram": "A picture of which frequencies are in a signal, and when: brighter is "
    "stronger.",
    "standard error, ±": "How far a value may typically be off; the true one is within twice of it "
    "in about 95 of 100 cases (the 95 % interval).",
    "usable second": "A second of the recording in which the flicker is clear enough to count.",
    "UTC": "Coordinated universal time: the world's common clock, without time zones or summer "
    "time.",
}
