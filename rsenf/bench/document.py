"""A table with what it was made from, as plain values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.claims_table import claims_rows
from rsenf.bench.enf_table import enf_rows
from rsenf.bench.groups import CELL, POOLED
from rsenf.bench.idle_table import PAPER_AVERAGE_ERROR_PERCENT, idle_rows


def tabulate(table: str, records: Sequence[Record], *, pooled: bool = False) -> dict[str, Any]:
    """Return a table's rows, and the seeds, grids and versions behind them.

    Parameters
    ----------
    table : {'idle', 'enf', 'claims'}
    records : sequence of Record
    pooled : bool, optional
        All sizes together.
    """
    by = POOLED if pooled else CELL
    document: dict[str, Any] = {
        "table": table,
        "clips": len(records),
        "seeds": sorted({record["seed"] for record in records}),
        "durations_s": sorted({record["duration_s"] for record in records}),
        "grids": sorted({record["grid"] for record in records}),
        "versions": [dict(v) for v in sorted({tuple(r["versions"].items()) for r in records})],
    }
    if table == "idle":
        document["paper_average_error_percent"] = PAPER_AVERAGE_ERROR_PERCENT
        document["rows"] = idle_rows(records, by)
    elif table == "enf":
        document["rows"] = enf_rows(records, by)
    else:
        document["rows"] = claims_rows(records)
    return document
