"""The tables of all trials with what they were made from, as plain values."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from rsenf.batch.journal import Record
from rsenf.bench.recording_time.paper import PUBLISHED
from rsenf.bench.recording_time.quality_table import evidence_rows, recovery_rows
from rsenf.bench.recording_time.table import (
    Row,
    absent_rows,
    cell_rows,
    mark_rows,
    order_rows,
    trials_of,
)


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
