"""The report as plain values: everything that the page shows, under stable keys with their types.

Includes advice on what would help if nothing, or nothing certain, was found.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, Literal, cast

import numpy as np
from typing_extensions import TypedDict  # Pydantic's, before Python 3.12

from rsenf.report.camera import idle_json
from rsenf.report.panels import Panel
from rsenf.report.recording_time import evidence, words
from rsenf.report.recording_time.pictures import left_out
from rsenf.report.recording_time.words import Basis, ReferenceFacts
from rsenf.report.values import number, texts
from rsenf.report.verdict import EditJson
from rsenf.timebase import nanoseconds, seconds, utc_text


class Claim(TypedDict):
    """The evaluation of a claimed start."""

    start_utc: str | None
    verdict: str
    meaning: str
    among: str
    likelihood_ratios: list[evidence.Comparison]
    tolerance_s: float
    after_best_time_s: float | None


class PictureFile(TypedDict):
    """A picture beside the page."""

    sha256: str
    file: str
    title: str
    caption: str
    alt: str
    width_px: int
    height_px: int


class Quality(TypedDict):
    """How much of the signal is usable, and how precise it is."""

    values: int
    usable_values: int
    median_std_hz: float | None
    median_snr_db: float | None
    unusable_reasons: dict[str, int]


class Search(TypedDict):
    """Extent and result of the search."""

    method: str
    best_reference: str
    starts_compared: int
    seconds_used: float
    residual_std_hz: float | None
    expected_std_hz: float | None


class Inputs(TypedDict):
    """The input files, each with its SHA-256, and the file of the verdict."""

    recording: dict[str, Any]
    references: list[dict[str, Any]]
    verdict: dict[str, str]


class Document(TypedDict):
    """A report on the time of a recording."""

    schema: str
    version: int
    made_utc: str
    kind: Literal["investigative", "evaluative"]
    kind_meaning: str
    case: dict[str, str] | None
    question: str
    answer: str
    decision: str
    result: dict[str, Any]
    propositions: dict[str, str]
    likelihood_ratios: list[evidence.Comparison]
    likelihood_ratio_texts: evidence.RatioTexts
    conditions: list[str]
    claim: Claim | None
    edits: list[EditJson]
    what_would_help: list[str]
    pictures: list[PictureFile]
    pictures_left_out: str
    quality: Quality
    idle: dict[str, Any] | None
    search: Search
    warnings: list[str]
    limits: list[str]
    inputs: Inputs
    command: str
    parameters: dict[str, dict[str, Any]]
    versions: dict[str, str]
    glossary: dict[str, str]
    files: list[str]


def what_would_help(case: Basis) -> list[str]:
    """Return advice on what could be done, the most useful first; nothing for a match."""
    result, advice = case.result, texts("recording_time")["advice"]
    if result.decision == "match":
        return []
    if not any(e.usable for e in case.estimates):
        return list(advice["no_signal"])
    if result.segments:
        return list(advice["edited"])
    gaps = advice["gaps"] if any(r.gaps for r in case.references) else []
    return [*advice[result.decision], *gaps]


SCHEMA = "rsenf.report.recording_time"
PAGE, NUMBERS, VERDICT = "report.html", "report.json", "result.json"
VERSION = 1


def verdict_bytes(case: Basis) -> bytes:
    """Return the content of the verdict's file: the bytes that ``verify --json`` prints."""
    return (json.dumps(case.verdict, indent=2, allow_nan=False) + "\n").encode()


def document_of(case: Basis, pictures: Sequence[Panel], made_utc: str) -> Document:
    """Return the report as a JSON document."""
    result, (name, meaning) = case.result, evidence.kind(case)
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "made_utc": made_utc,
        "kind": name,
        "kind_meaning": meaning,
        "case": case.verdict["case"],
        "question": words.question(case),
        "answer": words.answer(case),
        "decision": result.decision,
        "result": case.verdict,
        "propositions": evidence.propositions(case),
        "likelihood_ratios": evidence.comparisons(result),
        "likelihood_ratio_texts": evidence.ratio_texts(result),
        "conditions": evidence.conditions(case),
        "claim": _claim(case),
        "edits": case.verdict["edits"],
        "what_would_help": what_would_help(case),
        "pictures": [_picture(p) for p in pictures],
        "pictures_left_out": left_out(case),
        "quality": _quality(case),
        "idle": idle_json(case.idle) if case.idle else None,
        "search": _search(case),
        "warnings": case.verdict["warnings"],
        "limits": texts("recording_time")["limits"],
        "inputs": {
            "recording": dataclasses.asdict(case.recording),
            "references": [_reference(r) for r in case.references],
            "verdict": {"name": VERDICT, "sha256": _sha256(verdict_bytes(case))},
        },
        "command": case.command,
        "parameters": {group: dict(values) for group, values in case.parameters.items()},
        "versions": dict(case.versions),
        "glossary": texts("recording_time")["glossary"],
        "files": [PAGE, NUMBERS, VERDICT, *(p.file for p in pictures)],
    }


def _claim(case: Basis) -> Claim | None:
    result = case.result
    if not result.claim:
        return None
    away_ns = result.claimed_utc_ns - result.start_utc_ns
    return {
        "start_utc": utc_text(result.claimed_utc_ns),
        "verdict": result.claim,
        "meaning": texts("recording_time")["claims"][result.claim],
        "among": evidence.claim_among(case),
        "likelihood_ratios": evidence.claim_comparisons(result),
        "tolerance_s": case.settings.tolerance_s,
        "after_best_time_s": seconds(away_ns) if result.start_utc_ns else None,
    }


def _picture(picture: Panel) -> PictureFile:
    facts = dataclasses.asdict(picture)
    return cast(PictureFile, {"sha256": _sha256(facts.pop("png")), **facts})


def _quality(case: Basis) -> Quality:
    used = [e for e in case.estimates if e.usable]
    std_hz = np.array([e.enf_std_hz for e in used if e.enf_var_hz2 >= 0])
    snr_db = np.array([e.snr_db for e in used if math.isfinite(e.snr_db)])
    reasons = Counter(e.reason for e in case.estimates if not e.usable)
    return {
        "values": len(case.estimates),
        "usable_values": len(used),
        "median_std_hz": float(np.median(std_hz)) if std_hz.size else None,
        "median_snr_db": float(np.median(snr_db)) if snr_db.size else None,
        "unusable_reasons": dict(sorted(reasons.items())),
    }


def _search(case: Basis) -> Search:
    result = case.result
    return {
        "method": result.method,
        "best_reference": result.grid,
        "starts_compared": result.search_size,
        "seconds_used": result.seconds_used,
        "residual_std_hz": number(result.residual_std_hz),
        "expected_std_hz": number(result.expected_std_hz),
    }


def _reference(reference: ReferenceFacts) -> dict[str, Any]:
    facts = dataclasses.asdict(reference)
    t0_ns, span_s = facts.pop("t0_ns"), reference.samples * reference.step_s
    return {
        **facts,
        "start_utc": utc_text(t0_ns),
        "end_utc": utc_text(t0_ns + nanoseconds(span_s)) if t0_ns else None,
        "duration_s": span_s,
        "coverage_ratio": reference.valid_samples / max(reference.samples, 1),
        "notes": list(reference.notes),
    }


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
