"""Cases to report on: a clip that is found, and one without a signal."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from rsenf.match import Match
from rsenf.match.series import grid_of
from rsenf.messages import EnfEstimate, Header, MatchResult
from rsenf.report.picture import ThinRows
from rsenf.report.recording_time import Basis, RecordingFacts, ReferenceFacts
from rsenf.report.verdict import verdict_json
from rsenf.rows.stage import blocks_from_luminance
from tests.report.filmed import RATE_HZ, grid_hz, lit, reference

T0_NS = 1_700_000_000 * 10**9
BEGIN_S, SECONDS = 400, 180
FREQ_HZ = grid_hz(1500)
CASE = {"case": "K 4711/26", "exhibit": "E-3", "examiner": "", "laboratory": "", "received": ""}
CONTAINER = {
    "format": "QuickTime / MOV", "codec": "hevc Main", "pixel_format": "yuv420p", "width_px": 1920,
    "height_px": 1080, "bit_rate_bps": None, "duration_s": 180.0, "declared_rate_hz": 30.0,
    "rate_basis": "", "stamped_frames": 5400, "shortest_s": 0.033, "median_s": 0.0333,
    "longest_s": 0.1, "creation_time": "2026-01-15T08:00:00Z", "encoder": "", "make": "Acme",
    "model": "Eye 3",
}  # fmt: skip


def estimate(second: int, enf_hz: float) -> EnfEstimate:
    """What a tracker says of a second; of no use without a frequency."""
    usable = bool(np.isfinite(enf_hz))
    return EnfEstimate(
        header=Header(source="test/cam1"), nominal_hz=50.0, line_hz=100.0, enf_hz=enf_hz,
        start_pts_ns=second * 10**9, end_pts_ns=(second + 1) * 10**9, enf_var_hz2=(1e-4) ** 2,
        snr_db=40.0 + second % 7, usable=usable, reason="" if usable else "no mains flicker",
    )  # fmt: skip


def case_of(
    estimates: list[EnfEstimate], spectrum: ThinRows, claimed_s: float | None = None
) -> Basis:
    """Compare with the reference by correlation, with or without a claimed start."""
    blocks = reference(FREQ_HZ, T0_NS)
    claimed_ns = 0 if claimed_s is None else T0_NS + round(claimed_s * 1e9)
    match = Match(method="ncc", claimed_utc_ns=claimed_ns)
    for message in (*blocks, *estimates):
        match.update(message)
    (result,) = match.flush()
    return Basis(
        result=result,
        verdict=verdict_json(result, [*result.warnings, "a warning of the test's"])
        | {"case": CASE},
        estimates=estimates,
        spectrum=spectrum,
        grid=grid_of(blocks),
        recording=RecordingFacts(
            name="clip.mp4",
            bytes=1234,
            sha256="0" * 64,
            seconds=float(SECONDS),
            stretches=1,
            frame_rate_hz=29.97,
            container=CONTAINER,
        ),
        command="rsenf verify clip.mp4 --reference test.csv --report report",
        references=[reference_facts()],
        parameters={"command line": {"method": "ncc", "line": None}, "match": {"candidates": 5}},
        versions={"rsenf": "1.2.3", "numpy": "2.0"},
    )


def reference_facts(grid: str = "test") -> ReferenceFacts:
    return ReferenceFacts(
        name=f"{grid}.csv", bytes=98765, sha256="f" * 64, grid=grid, nominal_hz=50.0, t0_ns=T0_NS,
        step_s=1.0, samples=1500, valid_samples=1497, gaps=2, longest_gap_s=2.0, duplicates=1,
        notes=("gaps: 2, 3 s in all",),
    )  # fmt: skip


def found_case(claimed_s: float | None = BEGIN_S + 0.2) -> Basis:
    """Three minutes that the reference holds, but for two seconds of no use."""
    noise = np.random.default_rng(1).normal(0.0, 1e-4, SECONDS)
    enf_hz = FREQ_HZ[BEGIN_S : BEGIN_S + SECONDS] + noise
    enf_hz[[50, 51]] = np.nan
    estimates = [estimate(k, float(f)) for k, f in enumerate(enf_hz)]
    return case_of(estimates, spectrum_of(lit(FREQ_HZ, BEGIN_S, 12)), claimed_s)


def dark_case() -> Basis:
    """Three minutes without a light."""
    nothing = [estimate(k, float("nan")) for k in range(SECONDS)]
    return case_of(nothing, spectrum_of(np.full((300, 8, 1), 16.0, np.float32)), BEGIN_S)


def bare_case() -> Basis:
    """Not a single frame, so no picture to draw."""
    return dataclasses.replace(case_of([], ThinRows(), BEGIN_S), grid=None)


def spectrum_of(level: np.ndarray) -> ThinRows:
    rows = ThinRows()
    for block in blocks_from_luminance(level, np.arange(len(level)) / RATE_HZ, Header()):
        rows.add(block)
    return rows


def with_result(case: Basis, **changes: Any) -> Basis:
    """The same case with another outcome."""
    result: MatchResult = dataclasses.replace(case.result, **changes)
    verdict = case.verdict | verdict_json(result, list(case.verdict["warnings"]))
    return dataclasses.replace(case, result=result, verdict=verdict)
