"""The tables of all trials with what they were made from, as plain values.

Trials to what the results' own figures are worth: lag, clock error, likelihood ratios.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.groups import median, rms
from rsenf.bench.recording_time.paper import PUBLISHED
from rsenf.bench.recording_time.references import PRESENT
from rsenf.bench.recording_time.table import (
    Row,
    absent_rows,
    cell_rows,
    grouped,
    mark_rows,
    order_rows,
    trials_of,
)
from rsenf.bench.recording_time.trials import TRUE

WITHIN_STD = 2.0
# Edges of the logarithms of likelihood ratios; whatever is beyond is in the first or last bin.
EDGES = (-2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
RATIOS = {"other": "log10_lr", "absent": "log10_lr_absent"}


def recovery_rows(trials: Sequence[Row]) -> list[Row]:
    """Return errors of lag and clock of the true decisions, and what was said of them."""
    right = [t for t in trials if t.get("outcome") == TRUE]
    return [
        cell | {"trials": len(found)} | _errors(found, "lag", "s") | _errors(found, "clock", "ppm")
        for cell, found in grouped(right, "coding", "length_s", "method")
    ]


def _errors(found: Sequence[Row], what: str, unit: str) -> dict[str, Any]:
    pairs = [(t[f"{what}_error_{unit}"], t[f"{what}_std_{unit}"]) for t in found]
    known = [(e, s) for e, s in pairs if e is not None and s]
    within = [abs(e) <= WITHIN_STD * s for e, s in known]
    return {
        f"{what}_rms_{unit}": rms([e for e, _ in pairs if e is not None]),
        f"{what}_std_{unit}": median([s for _, s in known]),
        f"{what}_within": sum(within) / len(within) if within else None,
    }


def evidence_rows(trials: Sequence[Row]) -> list[Row]:
    """Return how often the best time was the true one, by the likelihood ratio it was given.

    ``other`` is against another time in the reference, of the trials that have the true one;
    ``absent`` against no time in it, of all trials.
    """
    rows = []
    for question, name in RATIOS.items():
        asked = [
            t | {"question": question, "bin": int(np.digitize(t[name], EDGES))}
            for t in trials
            if t.get(name) is not None and (question == "absent" or t["trial"] == PRESENT)
        ]
        asked.sort(key=lambda t: (t["method"], t["bin"]))
        rows += [
            {"method": cell["method"], "question": question}
            | _edges(cell["bin"])
            | {"trials": len(found), "right": sum(t["nearest"] for t in found)}
            for cell, found in grouped(asked, "method", "bin")
        ]
    return rows


def _edges(number: int) -> dict[str, float | None]:
    edges = (None, *EDGES, None)
    return {"from": edges[number], "to": edges[number + 1]}


def tabulate(records: Sequence[Record]) -> Row:
    """Return the tables, and the films and versions behind them.

    Parameters
    ----------
    records : sequence of dict
        Of :func:`rsenf.bench.recording_time.trials.run_trials`.
    """
    trials = trials_of(records)
    absent = absent_rows(trials)
    return {
        "table": "recording-time",
        "films": len({(r["kind"], r["seed"]) for r in records}),
        "seeds": sorted({r["seed"] for r in records}),
        "grids": sorted({r["grid"] for r in records}),
        "references_h": sorted({r["reference_s"] / 3600 for r in records}),
        "noise_mhz": sorted({r["noise_mhz"] for r in records}),
        "versions": [dict(v) for v in sorted({tuple(r["versions"].items()) for r in records})],
        "rows": cell_rows(trials),
        "absent": absent,
        "marks": mark_rows(trials, absent),
        "order": order_rows(trials),
        "recovery": recovery_rows(trials),
        "evidence": evidence_rows(trials),
        "published": [dataclasses.asdict(p) for p in PUBLISHED],
    }
