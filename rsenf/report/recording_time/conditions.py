"""The kind of report, and the conditions of the evidence, as the ENFSI guideline (2015) requires.

References
----------
ENFSI Guideline for Evaluative Reporting in Forensic Science, 2015.
"""

from __future__ import annotations

import math
from typing import Literal

from rsenf.match.calibration import calibration
from rsenf.report.recording_time.case import Case, ReferenceFacts
from rsenf.report.recording_time.ratios import propositions
from rsenf.report.recording_time.texts import RATIOLESS
from rsenf.report.recording_time.words import when
from rsenf.report.verdict import CALIBRATED
from rsenf.timebase import nanoseconds

KINDS = {
    "evaluative": "A claimed start was weighed against its alternatives. This supposes that the "
    "claim comes from elsewhere, and not out of a search of this very recording.",
    "investigative": "The time was searched for: the proposition H1 comes out of the recording "
    "itself. That is a lead, not a weighed claim. To evaluate one, have somebody who doesn't know "
    "this report name the start, and give it to --start.",
    "unweighed": "A start was claimed, but there is no likelihood ratio for it, so it was not "
    "weighed. What else is said comes of a search: that is investigative.",
}


def kind(case: Case) -> tuple[Literal["investigative", "evaluative"], str]:
    """Return 'evaluative' or 'investigative', and the reason in words."""
    result = case.result
    if not result.claimed_utc_ns:
        return "investigative", KINDS["investigative"]
    if math.isfinite(result.claim_log10_lr):
        return "evaluative", KINDS["evaluative"]
    return "investigative", KINDS["unweighed"]


def conditions(case: Case) -> list[str]:
    """Return, in sentences, the conditions under which the likelihood ratios hold."""
    result, names = case.result, ", ".join(propositions(case))
    usable = sum(e.usable for e in case.estimates)
    sentences = [
        f"Propositions: the evidence is weighed given {names}, two at a time. It says nothing of "
        f"any other.{_searched(case)}",
        f"Recording: the file {case.recording.name} with the SHA-256 below is the recording in "
        "question, one unedited piece, and its frame times run as the camera's clock did. "
        f"{usable} of {len(case.estimates)} values of its ENF are usable.",
        *(_reference(r) for r in case.references),
        "Light: the flicker in the recording is that of lamps on that grid, filmed as they shone.",
    ]
    if result.method not in RATIOLESS:
        settings = case.settings
        sentences.append(
            "Errors: allowed are those that the estimates state, "
            f"{1e3 * settings.reference_std_hz:g} mHz between the reference and the grid at the "
            f"lamp, and camera clocks that are off by about {settings.clock_scale_ppm:g} ppm "
            "(Student's distribution, 3 degrees of freedom)."
        )
    if result.method == CALIBRATED:
        sentences.append(
            "Calibration: a ratio holds for recordings like those that it was calibrated on: "
            f"{calibration().made}."
        )
    return [
        *sentences,
        "Circumstances: nothing else of the case was used. No probability is assumed of any of "
        "the propositions beforehand.",
        "Should one of these change or prove wrong, the evidence must be weighed anew.",
    ]


def _searched(case: Case) -> str:
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
