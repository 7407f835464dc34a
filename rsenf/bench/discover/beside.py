"""Cases of a clock error, with a reference of the grid.

A clock error shows only against an independent record of the grid: the true frequency, minutes
longer than the clip on either side, with the noise of such records.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.discover import Case, trial
from rsenf.bench.discover.judge import WRONG, answered, judged, recorded
from rsenf.bench.discover.trial import Drawn, drawn
from rsenf.bench.scenes import grid_for
from rsenf.discrepancy.clock_offset import beside_json, beside_of, clip_of, discover_beside, joined
from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.result import discovery_json, model_of
from rsenf.discrepancy.verdict import discover
from rsenf.match.series import Grid
from rsenf.messages import Header
from rsenf.model import GridPath, simulate_rows
from rsenf.model.noise import generator
from rsenf.rows.stage import blocks_from_luminance

CLOCK, SKEW = "clock", "clock_skew"
WEAKEST_PPM = 20.0  # least error that must be named in a clip of 60 s
TIMES = (3.0, 1.0)  # multiples of it
REFERENCE_S = 300.0
NOISE_HZ = (3e-4, 1e-3)  # of a sample of the reference; log-uniform


def clock_cases(each: int, first_seed: int, duration_s: float) -> list[Case]:
    """Return cases of each strength, and as many in all without a clock error.

    Parameters
    ----------
    each : int
        Cases of a strength.
    first_seed : int
        Each case has a seed of its own, from this one on.
    duration_s : float
    """
    hidden: list[tuple[tuple[str, ...], float]] = [((SKEW,), t) for t in TIMES for _ in range(each)]
    hidden += [((), 0.0) for _ in range(len(TIMES) * each)]
    return [
        Case(CLOCK, names, first_seed + n, times, duration_s, video=False)
        for n, (names, times) in enumerate(hidden)
    ]


def tried(case: Case, grids: Path | None) -> dict[str, Any]:
    """Run the workflow on a case; one of a clock error as ``rsenf discover --reference`` does.

    Parameters
    ----------
    case : Case
    grids : Path or None
        Folder of measured grids.
    """
    if case.kind != CLOCK:
        return trial.tried(case, grids)
    made, grid, lag_s, true_ppm = _drawn(case, grids)
    rows = simulate_rows(made.truth, made.grid, case.duration_s, case.seed, strips=made.strips)
    blocks = blocks_from_luminance(np.asarray(rows.level), rows.frame_time_s, Header())
    answer, reference, refused, cpu_s = answered(
        lambda: _told(made, measured_of(list(blocks)), grid)
    )
    clock = next((e for e in answer["effects"] if e["name"] == SKEW), None)
    ppm = clock["parameters"]["clock_ppm"] if clock else None
    off = ppm - true_ppm if ppm is not None and case.hidden else None
    reference = reference or {}
    return {
        **trial.drawn_facts(made),
        **recorded(case, answer, refused, cpu_s),
        "outcome": _outcome(case, answer, ppm, true_ppm),
        "true_ppm": true_ppm,
        "ppm": ppm,
        "relative_error": {SKEW: off / abs(true_ppm) if off is not None else None},
        "error_over_stderr": {
            SKEW: off / clock["stderr"]["clock_ppm"] if clock and off is not None else None
        },
        "gap": reference.get("gap", {}),
        "rows_gap": answer["gap"],
        "lag_off_s": reference["lag_s"] - lag_s if reference else None,
        "reference_std_hz": reference.get("std_hz"),
    }


def _outcome(case: Case, answer: dict[str, Any], ppm: float | None, true_ppm: float) -> str:
    """Return the outcome; a clock error of the wrong sign is wrong."""
    if ppm is not None and ppm * true_ppm < 0.0:
        return WRONG
    return judged("one" if case.hidden else "none", case.hidden, answer)


def clock_rows(records: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Group records of clock errors by the title of their row."""
    out: dict[str, list[dict[str, Any]]] = {}
    for record in records:
        if record["kind"] == CLOCK:
            size = f"{SKEW}, {record['times'] * WEAKEST_PPM:.0f} ppm"
            name = size if record["hidden"] else "a true clock, and a reference"
            out.setdefault(name, []).append(record)
    return dict(sorted(out.items(), key=lambda item: -item[1][0]["times"]))


def _drawn(case: Case, grids: Path | None) -> tuple[Drawn, Grid, float, float]:
    """Draw a case, its reference, the lag of the clip in it (s), and the clock error (ppm)."""
    made, rng = drawn(case, grids), generator(case.seed, "discover clock")
    nominal_hz = made.grid.nominal_hz
    path, name = grid_for(grids, nominal_hz, REFERENCE_S, rng)
    first = int(path.start_s / path.step_s)
    freq_hz = path.freq_hz[first : first + int(REFERENCE_S / path.step_s)]
    noise_hz = 10.0 ** rng.uniform(*np.log10(NOISE_HZ))
    heard_hz = freq_hz + noise_hz * rng.standard_normal(freq_hz.size)
    lag_s = float(rng.uniform(20.0, REFERENCE_S - case.duration_s - 20.0))
    path, truth = GridPath(freq_hz, path.step_s, lag_s, nominal_hz), made.truth
    ppm = float(rng.choice([-1.0, 1.0])) * case.times * WEAKEST_PPM
    if case.hidden:
        truth = truth.with_effect(SKEW, clock_ppm=ppm)
    made = dataclasses.replace(made, truth=truth, grid=path, grid_name=name)
    return made, Grid(name, nominal_hz, 0, path.step_s, heard_hz), lag_s, ppm


def _told(made: Drawn, data: Measured, grid: Grid) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the result on rows and reference, and the part on the reference."""
    laid = beside_of(clip_of(data), grid)
    found = discover(made.given, data)
    beside = discover_beside(model_of(found, "a case"), laid)
    answer = joined(discovery_json(found, ""), beside_json(beside, ""))
    return answer, answer["reference"]
