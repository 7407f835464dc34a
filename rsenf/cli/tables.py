"""The paper's idle tables and its figure of the strongest line, from the line model.

By default the numbers are right where the paper is wrong, and its errata are listed with the
reasons. With --as-published they are the paper's: M rounded to whole rows, lines of harmonic 1
above 0 Hz only, whole hertz and one decimal. The figure sets a simulation beside the model.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsenf.model.analytic_errata import Erratum
    from rsenf.model.analytic_figure import Point
    from rsenf.model.analytic_tables import Reading
    from rsenf.model.published import Entry

STEP_PERCENT, FINE_STEP_PERCENT = 5, 1  # of what is written, and of what is drawn


def add_arguments(parser: argparse.ArgumentParser) -> None:
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


def run(args: argparse.Namespace) -> int:
    """Make the tables.

    Raises
    ------
    RecordingError
        When a file can't be written.
    """
    from rsenf.cli.console import note, print_json
    from rsenf.errors import EXIT_DONE
    from rsenf.report.tables_text import tables_text

    drawn = _document(args, FINE_STEP_PERCENT if args.plots else STEP_PERCENT)
    document = _thinned(drawn)
    if args.json:
        print_json(document)
    else:
        print(tables_text(document))
    for path in _write_csv(args.csv, document) if args.csv else []:
        note(f"wrote {path}")
    for path in _draw(args.plots, drawn) if args.plots else []:
        note(f"wrote {path}")
    return EXIT_DONE


def _document(args: argparse.Namespace, step_percent: int) -> dict[str, Any]:
    """Everything that is shown, as plain values."""
    from rsenf.model.analytic import COSINE, RECTIFIED
    from rsenf.model.analytic_errata import errata
    from rsenf.model.analytic_simulation import ROWS
    from rsenf.model.analytic_tables import AS_PUBLISHED, Reading, idle_table, printed_table
    from rsenf.model.published import PUBLISHED_TABLES

    percents = range(0, 96, step_percent)
    if args.as_published:
        tabulate, reading, figure_reading = printed_table, AS_PUBLISHED, AS_PUBLISHED
    else:
        tabulate, figure_reading = idle_table, Reading(harmonics=RECTIFIED, rows=ROWS)
        reading = Reading(harmonics=COSINE if args.light == "cosine" else RECTIFIED)
    return {
        "as_published": args.as_published,
        "light": args.light,
        "tables": [
            {
                "frame_rate_hz": table.frame_rate_hz,
                "nominal_hz": table.nominal_hz,
                "rows": [
                    _row(entry)
                    for entry in tabulate(table.frame_rate_hz, table.nominal_hz, reading, percents)
                ],
                "printed": [_row(entry) for entry in table.entries],
            }
            for table in PUBLISHED_TABLES
        ],
        "figures": _figures(figure_reading, percents),
        "errata": [_erratum(erratum) for erratum in errata()],
    }


def _figures(reading: Reading, percents: range) -> list[dict[str, Any]]:
    """Simulate every case; a bar shows how far that is."""
    from rsenf.cli.console import progress_bar
    from rsenf.model.analytic_figure import CASES, strongest_against_idle
    from rsenf.model.analytic_simulation import DURATION_S

    figures: list[dict[str, Any]] = []
    with progress_bar("simulating", len(CASES) * len(percents) * DURATION_S) as progress:
        for frame_rate, nominal_hz in CASES:
            points = []
            for point in strongest_against_idle(frame_rate, nominal_hz, reading, percents):
                points.append(_point(point))
                progress((len(figures) * len(percents) + len(points)) * DURATION_S)
            figures.append(
                {
                    "frame_rate_hz": float(frame_rate),
                    "nominal_hz": nominal_hz,
                    "points": points,
                }
            )
    return figures


def _thinned(document: dict[str, Any]) -> dict[str, Any]:
    """Keep the idle periods that are written."""

    def thin(parts: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
        return [
            part | {key: [r for r in part[key] if r["idle_percent"] % STEP_PERCENT == 0]}
            for part in parts
        ]

    tables, figures = document["tables"], document["figures"]
    return document | {"tables": thin(tables, "rows"), "figures": thin(figures, "points")}


def _row(entry: Entry) -> dict[str, Any]:
    spread = entry.ratio_range
    return {
        "idle_percent": entry.idle_percent,
        "h1_hz": _one_or_list(entry.h1_hz),
        "h2_hz": _one_or_list(entry.h2_hz),
        "amplitude_ratio": entry.amplitude_ratio,
        "amplitude_ratio_range": spread and [r if math.isfinite(r) else None for r in spread],
    }


def _one_or_list(freq_hz: tuple[float, ...]) -> float | list[float] | None:
    """A number; a list where lines tie; None where there is no line."""
    rounded = [round(hz, 6) for hz in freq_hz]
    return rounded if len(rounded) > 1 else rounded[0] if rounded else None


def _point(point: Point) -> dict[str, Any]:
    low, high = point.model.amplitude_range()
    return {
        "idle_percent": point.idle_percent,
        "model_hz": round(point.model.freq_hz, 6),
        "model_amplitude": point.model.amplitude,
        "model_amplitude_range": [low, high],
        "light_phase_rad": point.phase_rad,
        "model_at_phase_hz": round(point.model_there.freq_hz, 6),
        "model_at_phase_amplitude": point.model_there.amplitude,
        "simulated_hz": point.simulated.freq_hz,
        "simulated_amplitude": point.simulated.amplitude,
    }


def _erratum(erratum: Erratum) -> dict[str, Any]:
    return {
        "name": erratum.name,
        "where": erratum.where,
        "published": erratum.published,
        "right": erratum.right,
        "entries": [
            {
                "frame_rate_hz": difference.frame_rate_hz,
                "nominal_hz": difference.nominal_hz,
                "idle_percent": difference.published.idle_percent,
                "published": _row(difference.published),
                "right": _row(difference.right),
            }
            for difference in erratum.entries
        ],
    }


def _write_csv(folder: Path, document: dict[str, Any]) -> list[Path]:
    from rsenf.report.tables_text import tables_csv
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
