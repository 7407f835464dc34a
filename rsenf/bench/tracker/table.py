"""What hours of video cost, as plain values, as text and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.tables import Row, shown, titled
from rsenf.bench.tracker.beside import AFTER

_HOUR = ("method", "settings", "rows", "frames/s", "hours", "s an hour", "ms a frame", "MB")
_BESIDE = ("stage", "ms a second", "÷ decode")
_SAMPLED = ("read", "means", "still", "moving")
_PLANES = ("plane", "copy", "read", "÷ copy", "row means", "÷ copy", "mask, still", "÷ copy",
           "mask, moving", "÷ copy")  # fmt: skip
_NOTE = """\
s an hour: seconds of processor time for an hour of rows, once flicker has been found; MB: the most
memory beyond what the program held before. ÷ decode: over PyAV decoding the film on one thread, in
the same round; after: all stages after the row means together, the usual settings, a result of the
match every minute. Planes, microseconds each: copied to one that the cache may hold; read once, for
the brightest pixel; one mean a row; two strips with the steady-pixel mask, everything up to the
block of rows. Lines are padded as decoders pad them. Medians of rounds of processor time, and of
their own ratios."""


def tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return the rows of the tables, and what they were made from."""
    of = {kind: [r for r in records if r["kind"] == kind] for kind in ("hour", "beside", "planes")}
    return {
        "table": "tracker",
        "loads": [min(r["load"] for r in records), max(r["load"] for r in records)],
        "versions": sorted({r["rsenf"] for r in records}),
        "rows": [_hour(r) for r in of["hour"]],
        "beside": [row for r in of["beside"] for row in _beside(r)],
        "planes": [_planes(r) for r in of["planes"]],
    }


def _hour(record: Record) -> Row:
    kept = ("method", "settings", "rows", "frame_rate_hz", "hours", "peak_mb")
    cpu_s = median(record["cpu_s_per_hour"])
    ms = 1e3 * cpu_s / 3600.0 / record["frame_rate_hz"]
    return {name: record[name] for name in kept} | {"cpu_s_per_hour": cpu_s, "ms_per_frame": ms}


def _beside(record: Record) -> list[Row]:
    parts = [p | {"after": sum(p[name] for name in AFTER)} for p in record["ms_per_s"]]
    return [
        {
            "stage": name,
            "ms_per_s": median(p[name] for p in parts),
            "over_decode": median(p[name] / p["decode"] for p in parts),
        }
        for name in parts[0]
    ]


def _planes(record: Record) -> Row:
    rounds = record["us"]
    over = {f"{name}_over_copy": median(r[name] / r["copy"] for r in rounds) for name in _SAMPLED}
    us = {f"{name}_us": median(r[name] for r in rounds) for name in rounds[0]}
    return {"size": record["size"]} | us | over


def text(document: Row, *, on_page: bool = False) -> str:
    """Return the tables, for a terminal or in Markdown."""
    low, high = document["loads"]
    notes = ["" if on_page else _NOTE, f"load of the machine: {low:.1f} to {high:.1f}"]
    tables = (
        ("An hour of video", _HOUR, [_hour_cells(row) for row in document["rows"]]),
        ("Beside decoding 1080p", _BESIDE, [_beside_cells(row) for row in document["beside"]]),
        ("Beside copying a plane", _PLANES, [_planes_cells(row) for row in document["planes"]]),
    )
    return titled(tables, [note for note in notes if note], on_page=on_page)


def _hour_cells(row: Row) -> list[str]:
    given = ", ".join(f"{name} {value:g}" for name, value in row["settings"].items())
    return [
        row["method"], given, f"{row['rows']}", f"{row['frame_rate_hz']:g}", f"{row['hours']:.2g}",
        f"{row['cpu_s_per_hour']:.1f}", f"{row['ms_per_frame']:.3f}",
        shown(row["peak_mb"], ".0f"),
    ]  # fmt: skip


def _beside_cells(row: Row) -> list[str]:
    return [row["stage"], f"{row['ms_per_s']:.2f}", f"{row['over_decode']:.2%}"]


def _planes_cells(row: Row) -> list[str]:
    sampled = (
        cell
        for name in _SAMPLED
        for cell in (f"{row[f'{name}_us']:.0f}", f"{row[f'{name}_over_copy']:.2f}")
    )
    return [row["size"], f"{row['copy_us']:.0f}", *sampled]
