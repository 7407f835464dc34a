"""Manage a store of grid frequency: months and years, several grids side by side.

    rsenf reference import FILE… --grid ce     CSV, Parquet, NPZ of days, or WAV of the mains
    rsenf reference list                       grids, steps, spans
    rsenf reference info ce                    imports, gaps, duplicates, contradictions
    rsenf reference export ce --out ce.csv     write a file again

Use it as a reference: store:ce, or store:ce@1?from=2024-08-01&to=2024-09-01. A grid is kept at each
time step that was imported; GRID@STEP names one, GRID alone the finest. Importing a file again
changes nothing. The store is $RSENF_STORE, or in the user's data folder; --store DIR names another.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

from rsenf.cli.console import add_store_verb, note, print_json, progress_bar, tell
from rsenf.cli.options import add_settings, settings_of
from rsenf.errors import EXIT_DONE, UsageError
from rsenf.reference.open import grid_name, utc_ns
from rsenf.reference.readings import ReadOptions
from rsenf.reference.store import (
    SampleFile,
    StoredSeries,
    all_series,
    coverage,
    default_store,
    export,
    facts,
    find_series,
    import_file,
    open_grid,
)
from rsenf.timebase import utc_text


def add_reference(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    verbs = parser.add_subparsers(dest="what", required=True, metavar="import|list|info|export")

    add = partial(add_store_verb, verbs)
    new = add("import", "read files into the store")
    new.add_argument("files", nargs="+", type=Path, metavar="FILE")
    new.add_argument("--grid", metavar="NAME", help="what to call it; as the file otherwise")
    add_settings(new, "reading", ReadOptions, leave_out=("assumed_hz", "start_utc_ns"))
    new.add_argument(
        "--start", metavar="TIME", help="of the first sample, for files that tell no dates"
    )
    add("list", "show which grids there are, at which steps, from when to when")
    add("info", "show what a grid is made of").add_argument("grid", metavar="GRID[@STEP]")
    out = add("export", "write a grid to a file that can be read as a reference again")
    out.add_argument("grid", metavar="GRID[@STEP]")
    out.add_argument(
        "--from", dest="from_", metavar="TIME", help="first sample; UTC unless it says"
    )
    out.add_argument("--to", metavar="TIME", help="end of the last one")
    out.add_argument("--out", type=Path, required=True, metavar="FILE", help=".csv or .parquet")


def run_reference(args: argparse.Namespace) -> int:
    """Import, list, describe or export."""
    store = args.store or default_store()
    _ACTIONS[args.what](args, store)
    return EXIT_DONE


def _import(args: argparse.Namespace, store: Path) -> None:
    if len(args.files) > 1 and not args.grid:
        raise UsageError(f"{len(args.files)} files and no name for their grid", "--grid NAME")
    start_ns = utc_ns(args.start, "--start") if args.start else 0
    options = settings_of(args, ReadOptions, start_utc_ns=start_ns)
    documents = []
    for path in args.files:
        grid, now_utc = args.grid or grid_name(path), str(utc_text(time.time_ns()))
        with progress_bar("importing", None, unit="rows") as progress:
            done = import_file(store, path, grid, options, imported_utc=now_utc, progress=progress)
        documents.append({"new": done.new, **_file_document(SampleFile(done.path))})
        if not args.json:
            d, to = documents[-1], f"{documents[-1]['grid']}@{documents[-1]['step_s']:g}"
            print(
                f"{d['file']}: {d['samples']} samples to {to}, {d['start_utc']} to {d['end_utc']}"
                if d["new"]
                else f"{d['file']}: in {to} already, since {d['imported_utc']}"
            )
            for line in done.record.notes:
                note(line)
    if args.json:
        print_json({"store": str(store), "imports": documents})


def _list(args: argparse.Namespace, store: Path) -> None:
    documents = [_series_document(series) for series in all_series(store)]
    if args.json:
        print_json({"store": str(store), "series": documents})
    elif documents:
        print(f"{'grid':<16} {'Hz':>3} {'step':>6}  {'from':<24} {'to':<24} {'there':>6} {'MB':>6}")
        for d in documents:
            print(
                f"{d['grid']:<16} {d['nominal_hz']:>3g} {d['step_s']:>4g} s  {d['start_utc']:<24} "
                f"{d['end_utc']:<24} {d['coverage']:>6.1%} {d['size_bytes'] / 1e6:>6.1f}"
            )
    else:
        note(f"the store {store} is empty; rsenf reference import FILE adds a grid")


def _info(args: argparse.Namespace, store: Path) -> None:
    documents = [_info_document(series) for series in find_series(store, args.grid)]
    text = "\n\n".join(map(_info_words, documents))
    tell(args, {"store": str(store), "series": documents}, text)


def _export(args: argparse.Namespace, store: Path) -> None:
    from_ns = utc_ns(args.from_, "--from") if args.from_ else None
    to_ns = utc_ns(args.to, "--to") if args.to else None
    reference = open_grid(store, args.grid, from_ns, to_ns)
    d = {
        "out": str(args.out),
        "grid": reference.grid,
        "step_s": reference.step_s,
        "start_utc": utc_text(reference.t0_ns),
        "end_utc": utc_text(reference.end_ns),
        "values": export(reference, args.out),
    }
    text = (
        f"{d['out']}: {d['values']} values of {d['grid']} at {d['step_s']:g} s, "
        f"{d['start_utc']} to {d['end_utc']}"
    )
    tell(args, d, text, reference.notes)


def _series_document(series: StoredSeries) -> dict[str, Any]:
    start, end = map(utc_text, series.span_ns)
    return {
        "grid": series.grid,
        "nominal_hz": series.nominal_hz,
        "step_s": series.step_s,
        "start_utc": start,
        "end_utc": end,
        "coverage": round(coverage(series), 6),
        "imports": len(series.files),
        "size_bytes": sum(file.path.stat().st_size for file in series.files),
    }


def _info_document(series: StoredSeries) -> dict[str, Any]:
    found = facts(series)
    return {
        **_series_document(series),
        "samples": found.total,
        "valid": found.valid,
        "gaps": found.gaps,
        "longest_gaps": [
            {"start_utc": utc_text(series.raster.time_ns(first)), "duration_s": n * series.step_s}
            for n, first in found.longest
        ],
        "duplicates": found.repeated,
        "contradictions": found.contradicted,
        "mean_hz": round(found.mean_hz, 6),
        "std_hz": round(found.std_hz, 6),
        "imports": [_file_document(file) for file in series.files],
    }


def _info_words(d: dict[str, Any]) -> str:
    step_s, missing = d["step_s"], d["samples"] - d["valid"]
    lines = [
        f"{d['grid']}@{step_s:g}: {d['nominal_hz']:g} Hz grid, {d['start_utc']} to {d['end_utc']}",
        f"  values          {d['valid']} of {d['samples']} ({d['valid'] / d['samples']:.1%})",
        f"  mean, std       {d['mean_hz']:.4f} Hz, {d['std_hz'] * 1e3:.1f} mHz",
        f"  gaps            {d['gaps']}" + (f", in all {_long(missing * step_s)}" * bool(missing)),
    ]
    lines += [f"    {_long(g['duration_s']):>20} from {g['start_utc']}" for g in d["longest_gaps"]]
    lines += [
        f"  duplicates      {d['duplicates']} samples have several readings",
        f"  contradictions  {d['contradictions']} of them disagree by over 5 mHz: gaps",
        f"  imports         {len(d['imports'])}",
    ]
    for file in d["imports"]:
        lines.append(
            f"    {file['file']}, {file['start_utc']} to {file['end_utc']}, "
            f"sha256 {file['sha256'][:16]}, on {file['imported_utc']}"
        )
        lines += [f"      {note}" for note in file["notes"]]
    return "\n".join(lines)


def _long(duration_s: float) -> str:
    return str(timedelta(seconds=duration_s))


def _file_document(file: SampleFile) -> dict[str, Any]:
    record = asdict(file.record)
    start, end = map(utc_text, file.span_ns)
    return {
        "file": record.pop("name"),
        "start_utc": start,
        "end_utc": end,
        "step_s": record.pop("step_ns") / 1e9,
        "kept_as": str(file.path),
        **record,
    }


_ACTIONS = {"import": _import, "list": _list, "info": _info, "export": _export}
