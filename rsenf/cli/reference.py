"""Keep months and years of grid frequency, several grids side by side, and see what is there.

    rsenf reference import FILE… --grid ce     CSV, Parquet, NPZ of days, or WAV of the mains
    rsenf reference list                       grids, steps, spans
    rsenf reference info ce                    imports, gaps, duplicates, contradictions
    rsenf reference export ce --out ce.csv     a file again

Use it as a reference: store:ce, or store:ce@1?from=2024-08-01&to=2024-09-01. A grid is kept at each
step that it came in; GRID@STEP names one, GRID alone the finest. Importing a file again changes
nothing. The store is $RSENF_STORE, or in the user's data folder; --store DIR names another.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsenf.reference.options import ReadOptions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    from rsenf.cli.console import add_reference_arguments

    verbs = parser.add_subparsers(dest="what", required=True, metavar="import|list|info|export")

    def add(what: str, help_line: str) -> argparse.ArgumentParser:
        sub = verbs.add_parser(what, help=help_line, description=help_line)
        sub.add_argument("--store", type=Path, metavar="DIR", help="of the store")
        sub.add_argument("--json", action="store_true")
        return sub

    new = add("import", "read files into the store")
    new.add_argument("files", nargs="+", type=Path, metavar="FILE")
    new.add_argument("--grid", metavar="NAME", help="what to call it; as the file otherwise")
    add_reference_arguments(new)
    new.add_argument(
        "--nominal-hz",
        type=float,
        choices=(50.0, 60.0),
        help="grid; told from the values otherwise",
    )
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


def run(args: argparse.Namespace) -> int:
    """Import, list, inform or export."""
    from rsenf.errors import EXIT_DONE
    from rsenf.reference.store import default_store

    store = args.store or default_store()
    _ACTIONS[args.what](args, store)
    return EXIT_DONE


def _import(args: argparse.Namespace, store: Path) -> None:
    from rsenf.cli.console import note, print_json, progress_bar
    from rsenf.cli.reference_text import import_document, import_words
    from rsenf.errors import UsageError
    from rsenf.reference.read import grid_name
    from rsenf.reference.store import import_file

    if len(args.files) > 1 and not args.grid:
        raise UsageError(f"{len(args.files)} files and no name for their grid", "--grid NAME")
    options = _options(args)
    documents = []
    for path in args.files:
        with progress_bar("importing", None, unit="rows") as progress:
            done = import_file(
                store,
                path,
                args.grid or grid_name(path),
                options,
                imported_utc=_now(),
                progress=progress,
            )
        documents.append(import_document(done))
        if not args.json:
            print(import_words(documents[-1]))
            for line in done.record.notes:
                note(line)
    if args.json:
        print_json({"store": str(store), "imports": documents})


def _list(args: argparse.Namespace, store: Path) -> None:
    from rsenf.cli.console import note, print_json
    from rsenf.cli.reference_text import list_words, series_document
    from rsenf.reference.store import all_series

    documents = [series_document(series) for series in all_series(store)]
    if args.json:
        print_json({"store": str(store), "series": documents})
    elif documents:
        print(list_words(documents))
    else:
        note(f"the store {store} is empty; rsenf reference import FILE adds a grid")


def _info(args: argparse.Namespace, store: Path) -> None:
    from rsenf.cli.console import print_json
    from rsenf.cli.reference_text import info_document, info_words
    from rsenf.reference.store import find_series

    documents = [info_document(series) for series in find_series(store, args.grid)]
    if args.json:
        print_json({"store": str(store), "series": documents})
    else:
        print("\n\n".join(info_words(document) for document in documents))


def _export(args: argparse.Namespace, store: Path) -> None:
    from rsenf.cli.console import note, print_json
    from rsenf.cli.reference_text import export_document, export_words
    from rsenf.reference.moments import utc_ns
    from rsenf.reference.store import export, open_grid

    from_ns = utc_ns(args.from_, "--from") if args.from_ else None
    to_ns = utc_ns(args.to, "--to") if args.to else None
    reference = open_grid(store, args.grid, from_ns, to_ns)
    document = export_document(reference, args.out, export(reference, args.out))
    if args.json:
        print_json(document)
        return
    print(export_words(document))
    for line in reference.notes:
        note(line)


def _options(args: argparse.Namespace) -> ReadOptions:
    from rsenf.reference.moments import utc_ns
    from rsenf.reference.options import ReadOptions

    return ReadOptions(
        timezone=args.timezone,
        step_s=args.step_s,
        column=args.column,
        nominal_hz=args.nominal_hz,
        stamp=args.stamp,
        start_utc_ns=utc_ns(args.start, "--start") if args.start else 0,
    )


def _now() -> str:
    import time

    from rsenf.timebase import utc_text

    return str(utc_text(time.time_ns()))


_ACTIONS = {"import": _import, "list": _list, "info": _info, "export": _export}
