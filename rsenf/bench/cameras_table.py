"""Identification of cameras by their read-out time, in simulated fleets.

The recordings of a fleet aren't filmed: each has the error and the standard error, relative to the
read-out time, of a clip that was filmed, encoded and estimated at its frame rate. An error common
to all recordings of a camera, as real ones may have, isn't modelled. True read-out times are of
idle ratios uniform over the range of the paper's cameras, which isn't the prior of the likelihood
ratio; two cameras of a mode are of one model, with the same time, at the rate that the prior
assumes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.calibration import Pairs, cost_of_ratios, reliability
from rsenf.bench.calibration.table import RELIABILITY
from rsenf.bench.clip_tables import clips_of
from rsenf.bench.harness import BenchRun, Made
from rsenf.bench.scenes import IDLE_RATIO
from rsenf.bench.statistics import rate_bound
from rsenf.bench.tables import Column, table_of, titled
from rsenf.idle import IdleSettings, compare
from rsenf.match.calibration import CalibrationLine
from rsenf.model import parse_frame_rate

METHOD = IdleSettings().method
CAMERAS, KNOWN_BY = 50, 2  # in a fleet; known recordings of each
STRENGTHS = (0.5, 1.0, 1.5, 1.9, 2.5)
AS_IT_IS = CalibrationLine(1.0, 0.0, 9.0)
LINES = 240

Errors = dict[str, list[tuple[float, float]]]


def _measured_errors(records: Sequence[Record]) -> tuple[Errors, int]:
    """Return errors and standard errors by frame rate, over the read-out time, and the tries."""
    errors: Errors = {}
    tried = 0
    for record in records:
        at_rate = errors.setdefault(record["frame_rate"], [])
        read_percent = 100.0 - record["idle_percent"]
        for found in record["found"].values():
            estimate, tried = found["idle"][METHOD], tried + 1
            if estimate.get("verdict") == "estimated":
                error, std = -estimate["error_percent"], estimate["std_percent"]
                at_rate.append((error / read_percent, std / read_percent))
    return {rate: drawn for rate, drawn in errors.items() if drawn}, tried


def _tabulated(records: Sequence[Record], fleets: int, seed: int) -> dict[str, Any]:
    """Simulate fleets, the first of some seed, with the measured errors; return rates."""
    errors, tried = _measured_errors(records)
    return {
        "table": "cameras",
        "clips": len(records),
        "seeds": sorted({record["seed"] for record in records}),
        "estimates": sum(map(len, errors.values())),
        "tried": tried,
        "fleets": fleets,
        "cameras": CAMERAS,
        "cases": [
            _case(errors, fleets, seed, same) for same in (compare.SAME_MODEL_RATIO, 0.0) if errors
        ],
    }


def _case(errors: Errors, fleets: int, seed: int, same_model_ratio: float) -> dict[str, Any]:
    """Return rates of identification for a known share of cameras of one model."""
    ratios = [
        one
        for fleet in range(seed, seed + fleets)
        for one in _fleet(errors, same_model_ratio, np.random.default_rng([fleet, 25]))
    ]
    held = np.array([true for true, _ in ratios])
    failed = np.array([other for _, others in ratios for other in others])
    rank = np.array([1 + sum(other > true for other in others) for true, others in ratios])
    odds = np.array([compare.log10_odds([true, *others]) for true, others in ratios])
    absent = np.array([compare.log10_odds(others) for _, others in ratios if others])
    pairs = Pairs(held, failed)
    return {
        "same_model_ratio": same_model_ratio,
        "recordings": held.size,
        "comparisons": failed.size,
        "rank": {str(n): float(np.mean(rank <= n)) for n in (1, 2, 3)},
        "excluded": int(np.sum(held <= compare.DIFFERENT)),
        "others_excluded": int(np.sum(failed <= compare.DIFFERENT)),
        "cllr_bits": cost_of_ratios(pairs, AS_IT_IS),
        "rows": [
            {
                "log10": limit,
                "own": int(np.sum(held >= limit)),
                "other": int(np.sum(failed >= limit)),
                "other_below": rate_bound(int(np.sum(failed >= limit)), failed.size),
                "found": int(np.sum((odds >= limit) & (rank == 1))),
                "found_wrong": int(np.sum((odds >= limit) & (rank > 1))),
                "absent_found": int(np.sum(absent >= limit)),
            }
            for limit in STRENGTHS
        ],
        "reliability": reliability(pairs, AS_IT_IS),
    }


def _fleet(
    errors: Errors, same_model_ratio: float, rng: np.random.Generator
) -> list[tuple[float, list[float]]]:
    """Simulate a fleet; return log10 LRs of new recordings: with their camera, with the others."""
    out = []
    for turn, (rate, drawn) in enumerate(errors.items()):
        mode = compare.Mode(frame_rate_hz=float(parse_frame_rate(rate)), lines=LINES)
        times_s: list[float] = []
        for _ in range(turn, CAMERAS, len(errors)):
            time_s = (1.0 - rng.uniform(*IDLE_RATIO)) / mode.frame_rate_hz
            is_alike = rng.random() < same_model_ratio * len(times_s)
            times_s.append(float(rng.choice(times_s)) if is_alike else time_s)
        recordings = [
            tuple(_reading(time_s, mode, drawn, rng) for _ in range(KNOWN_BY)) for time_s in times_s
        ]
        known = [compare.Known(str(n), mode, found) for n, found in enumerate(recordings)]
        for n, time_s in enumerate(times_s):
            reading = _reading(time_s, mode, drawn, rng)
            ratios = [compare.log10_lr(camera, reading, same_model_ratio) for camera in known]
            out.append((ratios.pop(n), ratios))
    return out


def _reading(
    time_s: float, mode: compare.Mode, drawn: list[tuple[float, float]], rng: np.random.Generator
) -> compare.ReadOutTime:
    error, std = drawn[rng.integers(len(drawn))]
    return compare.ReadOutTime(
        recording="", mode=mode, direction="",
        read_out_time_s=time_s * (1.0 + error), read_out_time_std_s=time_s * std,
    )  # fmt: skip


def _text(document: dict[str, Any], *, on_page: bool = False) -> str:
    told = {**document, "known": KNOWN_BY, "first": document["seeds"][0]}
    made = (
        "{fleets} fleets of {cameras} cameras, {known} recordings of each known and one in "
        "question, with the errors of {estimates} estimates (of {tried} tried) in {clips} clips, "
        "seeds {first} to {last}"
    ).format(**told, last=document["seeds"][-1])
    parts = [_case_text(case, on_page=on_page) for case in document["cases"]]
    return "\n\n".join([*parts, _NOTE, made])


def _case_text(case: dict[str, Any], *, on_page: bool) -> str:
    ranks = ", ".join(f"{n}: {share:.1%}" for n, share in case["rank"].items())
    title = (
        f"{case['same_model_ratio']:.0%} of the cameras of one model; {case['recordings']} "
        f"recordings, {case['comparisons']} comparisons with other cameras of the mode"
    )
    found = (
        f"own camera at rank {ranks}; Cllr {case['cllr_bits']:.3f} bits; excluded (10^"
        f"{compare.DIFFERENT:g}): {case['excluded']} own cameras, {case['others_excluded']} others"
    )
    reliable = table_of("What a ratio was worth", RELIABILITY, case["reliability"])
    return titled([table_of(title, _COLUMNS, case["rows"]), reliable], [found], on_page=on_page)


_COLUMNS: tuple[Column, ...] = (
    ("log10 ≥", "log10", "g"), ("own", "own"), ("other", "other"),
    ("below, 95 %", "other_below", ".2%"), ("best, right", "found"), ("wrong", "found_wrong"),
    ("own one unknown", "absent_found"),
)  # fmt: skip
_NOTE = """\
own, other: comparisons with the recording's own camera, and with others, of at least such a ratio;
best: recordings whose best camera has at least such odds against all others."""


def measure(run: BenchRun) -> Made:
    """Measure the clips that are missing, and draw fleets with their errors."""
    plan, records = clips_of(run)
    return Made(_tabulated(records, run.options.fleets, plan.first_seed), _text)
