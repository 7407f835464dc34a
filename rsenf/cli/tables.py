"""Reproduce the paper's idle tables and its figure of the strongest line from the line model.

By default the numbers are corrected where the paper is wrong, and its errata are listed with the
reasons. With --as-published they are the paper's: M rounded to whole rows, lines of harmonic 1
above 0 Hz only, whole hertz and one decimal. The figure compares a simulation with the model.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_tables(parser: argparse.ArgumentParser) -> None:
    """Arguments of the verb."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--as-published", action="store_true", help="the paper's own numbers")
    which.add_argument(
        "--light", choices=("cosine", "rectified"), default="cosine",
        help="of the tables: one harmonic, or |cos|, which the figure always has",
    )  # fmt: skip
    parser.add_argument("--csv", type=Path, metavar="DIR", help="write each table to a file too")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw pictures too, as PNG")
    parser.add_argument("--json", action="store_true")


def run_tables(args: argparse.Namespace) -> int:
    """Make the tables."""
    from rsenf.cli.console import note, progress_bar, tell
    from rsenf.errors import EXIT_DONE
    from rsenf.report.tables import (
        FINE_STEP_PERCENT,
        STEP_PERCENT,
        simulated_s,
        tables_document,
        tables_text,
        thinned,
    )

    step_percent = FINE_STEP_PERCENT if args.plots else STEP_PERCENT
    with progress_bar("simulating", simulated_s(step_percent)) as progress:
        drawn = tables_document(
            as_published=args.as_published, light=args.light, step_percent=step_percent,
            progress=progress,
        )  # fmt: skip
    document = thinned(drawn)
    tell(args, document, tables_text(document))
    for path in _write_csv(args.csv, document) if args.csv else []:
        note(f"wrote {path}")
    for path in _draw(args.plots, drawn) if args.plots else []:
        note(f"wrote {path}")
    return EXIT_DONE


def _write_csv(folder: Path, document: dict[str, Any]) -> list[Path]:
    from rsenf.report.tables import tables_csv
    from rsenf.whole_file import whole_file

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, text in tables_csv(document).items():
        written.append(folder / name)
        with whole_file(written[-1]) as part:
            part.write_text(text, encoding="utf-8")
    return written


def _draw(folder: Path, document: dict[str, Any]) -> list[Path]:
    from rsenf.report.tables_picture import draw_idle_tables, draw_strongest

    folder.mkdir(parents=True, exist_ok=True)
    tables, strongest = folder / "idle_tables.png", folder / "strongest_line.png"
    draw_idle_tables(tables, document)
    draw_strongest(strongest, document)
    return [tables, strongest]
