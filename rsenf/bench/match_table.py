"""Tables of the searches of long references, and of the match stage on a stream."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.match_trial import RUN, RUNS
from rsenf.bench.tables import aligned, markdown, shown, versions_of

SPANS = {1: "a day", 7: "a week", 30: "a month", 365: "a year", 3653: "ten years"}
_HEAD = (
    "reference", "samples", "gaps", "clip there", "found", "error", "search", "ns a sample",
    "MB", "all lags", "loop", "÷ all lags", "÷ search", "plain FFT",
)  # fmt: skip
_NOTE = """\
search: blind, by the method phase, from a clip's estimates to the verdict, the reference read from
the store as the search goes on; all lags: the part of it that looks at every lag, its reading
included. loop: the same comparison of every lag by a plain loop in NumPy over a reference in memory
(subtract, leave out gaps, mean, variance), timed on {sampled} lags and scaled; in brackets, all of
a day's. ÷ all lags: loop over that; ÷ search: the search with the loop in it over the search.
plain FFT: scipy.signal.correlate of the whole reference, to no verdict. Seconds of processor time,
medians, the ratios' of each round's own; MB: the most memory that a search took, beyond what the
program held before it. found: clips, of so many; error: the worst; clip there: how much of the
clip's time isn't a gap."""


_STREAM_HEAD = ("clip", "results", "matches", "all results", "the last one", "ms a second", "MB")
_STREAM_NOTE = """\
A clip that comes in second by second, searched for in a day of reference: at every minute, later
whenever a quarter more of it is there, and at the end, where the finding is examined, too. Seconds
of processor time of the stage; ms a second: of the clip; MB: the most memory beyond the start's."""


def tabulated(records: Sequence[Record], streams: Sequence[Record] = ()) -> dict[str, Any]:
    """Return the tables as plain values.

    Parameters
    ----------
    records : sequence of dict
        Of searches.
    streams : sequence of dict, optional
        Of streams.
    """
    return {
        "table": "match",
        "streams": list(streams),
        "clip_s": sorted({r["clip_s"] for r in records}),
        "seeds": sorted({r["seed"] for r in records}),
        "repeats": sorted({r["repeats"] for r in records}),
        "grids": sorted({r["grid"] for r in records}),
        "loads": [min(r["load"] for r in records), max(r["load"] for r in records)],
        "versions": versions_of(records),
        "rows": [_row(r) for r in records],
    }


def _row(record: Record) -> dict[str, Any]:
    kept = ("days", "gaps", "clip_s", "samples", "missing_ratio", "clip_in_reference_ratio",
            "repeats", "right", "worst_error_s", "cpu_s", "loop_over_lags", "loop_over_search",
            "peak_mb")  # fmt: skip
    ns = record["cpu_s"]["search"] / record["samples"] * 1e9
    return {name: record[name] for name in kept} | {"ns_a_sample": ns}


def text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Return the tables for a terminal or in Markdown."""
    written, made = markdown if on_page else aligned, _made_from(document)
    rows = written(_HEAD, map(_cells, document["rows"]))
    streams = written(_STREAM_HEAD, map(_stream_cells, document["streams"]))
    if on_page:
        return f"{rows}\n\n{made}\n\n{streams}"
    note = _NOTE.format(sampled=f"{RUNS * RUN:,}")
    return f"{rows}\n\n{note}\n{made}\n\n{streams}\n\n{_STREAM_NOTE}"


def _cells(row: dict[str, Any]) -> list[str]:
    cpu_s, error_s = row["cpu_s"], row["worst_error_s"]
    whole = f" ({cpu_s['whole_loop']:.2f} s)" if "whole_loop" in cpu_s else ""
    return [
        SPANS.get(row["days"], f"{row['days']} days"), f"{row['samples']:,}",
        f"{row['missing_ratio']:.0%}" if row["gaps"] else "none",
        f"{row['clip_in_reference_ratio']:.0%}", f"{row['right']} of {row['repeats']}",
        shown(error_s, ".2f", " s"), f"{cpu_s['search']:.2f} s", f"{row['ns_a_sample']:,.0f}",
        shown(row["peak_mb"], ".0f"), f"{cpu_s['lags']:.3g} s", f"{cpu_s['loop']:,.3g} s{whole}",
        f"{row['loop_over_lags']:.0f}", f"{row['loop_over_search']:.0f}",
        shown(cpu_s.get("correlate"), ".2f", " s"),
    ]  # fmt: skip


def _stream_cells(row: Record) -> list[str]:
    return [
        f"{row['clip_s'] / 60:g} min" if row["clip_s"] < 3600 else f"{row['clip_s'] / 3600:g} h",
        f"{row['results']}", f"{row['matches']}", f"{row['cpu_s']:.2f} s",
        f"{row['cpu_s'] - row['coming_cpu_s']:.2f} s", f"{row['cpu_s'] / row['clip_s'] * 1e3:.2f}",
        shown(row["peak_mb"], ".0f"),
    ]  # fmt: skip


def _made_from(document: dict[str, Any]) -> str:
    clips = ", ".join(f"{s:g}" for s in document["clip_s"])
    repeats = ", ".join(f"{n}" for n in document["repeats"])
    low, high = document["loads"]
    return (
        f"clips: {clips} s; grid: {', '.join(document['grids'])}, and days like it; "
        f"medians of {repeats}; load of the machine: {low:.1f} to {high:.1f}"
    )
