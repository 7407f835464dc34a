"""Times of searches of long references, as plain values, as text and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.text import aligned, markdown

SPANS = {1: "a day", 7: "a week", 30: "a month", 365: "a year"}
_HEAD = (
    "reference", "samples", "gaps", "clip there", "found", "error", "store", "memory", "correlate",
    "oaconvolve", "÷ correlate", "÷ oaconvolve", "MB", "correlate MB",
)  # fmt: skip
_NOTE = """\
Blind search of the phase matcher, from a clip's estimates to the verdict; store: the reference read
from the store as the search goes on; memory: held as an array. Beside them, in turn, a plain FFT
correlation of the clip with the whole reference (scipy.signal.correlate, method="fft") and one in
stretches (oaconvolve). Seconds of processor time, medians; ÷: memory over the plain one. MB: the
most memory that a search of the store took, beyond what the program held before it; clip there: how
much of the clip's time isn't a gap."""


def tabulate(records: Sequence[Record]) -> dict[str, Any]:
    """Return the rows of the table, and what they were made from."""
    return {
        "table": "search",
        "clip_s": sorted({r["clip_s"] for r in records}),
        "seeds": sorted({r["seed"] for r in records}),
        "repeats": sorted({r["repeats"] for r in records}),
        "grids": sorted({r["grid"] for r in records}),
        "versions": [dict(v) for v in sorted({tuple(r["versions"].items()) for r in records})],
        "rows": [_row(r) for r in records],
    }


def _row(record: Record) -> dict[str, Any]:
    cpu_s = record["cpu_s"]
    kept = ("days", "gaps", "clip_s", "samples", "missing_ratio", "clip_in_reference_ratio",
            "decision", "right", "lag_error_s", "seconds", "cpu_s", "peak_mb")  # fmt: skip
    ratios = {f"over_{name}": cpu_s["memory"] / cpu_s[name] for name in ("correlate", "oaconvolve")}
    return {name: record[name] for name in kept} | ratios


def text(document: dict[str, Any]) -> str:
    """Return the table for a terminal."""
    rows = (_cells(row) for row in document["rows"])
    return f"{aligned(_HEAD, rows)}\n\n{_NOTE}\n{_made_from(document)}"


def page(document: dict[str, Any]) -> str:
    """Return the table in Markdown."""
    return f"{markdown(_HEAD, map(_cells, document['rows']))}\n\n{_made_from(document)}"


def _cells(row: dict[str, Any]) -> list[str]:
    cpu_s, peak_mb, error_s = row["cpu_s"], row["peak_mb"], row["lag_error_s"]
    found = row["decision"] if row["right"] else f"{row['decision']}, wrong place"
    return [
        SPANS.get(row["days"], f"{row['days']} days"),
        f"{row['samples']:,}",
        f"{row['missing_ratio']:.0%}" if row["gaps"] else "none",
        f"{row['clip_in_reference_ratio']:.0%}",
        found,
        "–" if error_s is None else f"{error_s:+.2f} s",
        *(f"{cpu_s[name]:.2f} s" for name in ("store", "memory", "correlate", "oaconvolve")),
        f"{row['over_correlate']:.3g}",
        f"{row['over_oaconvolve']:.3g}",
        *(f"{peak_mb[name]:.0f}" if name in peak_mb else "–" for name in ("store", "correlate")),
    ]


def _made_from(document: dict[str, Any]) -> str:
    clips = ", ".join(f"{s:g}" for s in document["clip_s"])
    repeats = ", ".join(f"{n}" for n in document["repeats"])
    return (
        f"clip: {clips} s; grid: {', '.join(document['grids'])}, and days like it; "
        f"medians of {repeats}"
    )
