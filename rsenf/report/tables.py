"""The paper's idle tables, its figure of the strongest line, and its errata.

As plain values, which ``rsenf tables`` prints as JSON, and these as text and CSV.
"""

from __future__ import annotations

import csv
import io
import math
import textwrap
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rsenf.model.analytic import COSINE, RECTIFIED
from rsenf.model.analytic_errata import (
    CASES,
    DURATION_S,
    ROWS,
    Erratum,
    IdlePoint,
    errata,
    strongest_against_idle,
)
from rsenf.model.analytic_tables import (
    AS_PUBLISHED,
    PUBLISHED_TABLES,
    ModelReading,
    Row,
    idle_table,
    printed_table,
)

STEP_PERCENT, FINE_STEP_PERCENT = 5, 1  # step of idle periods in text, and in pictures


def tables_document(
    *,
    as_published: bool = False,
    light: str = "cosine",
    step_percent: int = STEP_PERCENT,
    progress: Callable[[float], None] = lambda simulated_s: None,
) -> dict[str, Any]:
    """Return the paper's tables and figures, and its errata, as plain values.

    Parameters
    ----------
    as_published : bool
        Whether to compute the paper's printed numbers instead of the corrected ones.
    light : {'cosine', 'rectified'}
        Waveform of the light in the tables; the figures always use ``rectified``, |cos|.
    step_percent : int
        Step of the idle period, in per cent of the frame period.
    progress : callable, optional
        Called with the number of seconds simulated, of :func:`simulated_s` in total.
    """
    percents = _percents(step_percent)
    tabulate, reading, of_figures = printed_table, AS_PUBLISHED, AS_PUBLISHED
    if not as_published:
        tabulate, of_figures = idle_table, ModelReading(harmonics=RECTIFIED, rows=ROWS)
        reading = ModelReading(harmonics=COSINE if light == "cosine" else RECTIFIED)
    figures: list[dict[str, Any]] = []
    for rate_hz, nominal_hz in CASES:
        points: list[dict[str, Any]] = []
        for point in strongest_against_idle(rate_hz, nominal_hz, of_figures, percents):
            points.append(_point(point))
            progress((len(figures) * len(percents) + len(points)) * DURATION_S)
        case = {"frame_rate_hz": float(rate_hz), "nominal_hz": nominal_hz}
        figures.append(case | {"points": points})
    tables = [
        {
            "frame_rate_hz": printed.frame_rate_hz,
            "nominal_hz": printed.nominal_hz,
            "rows": [
                *map(_row, tabulate(printed.frame_rate_hz, printed.nominal_hz, reading, percents))
            ],
            "printed": [*map(_row, printed.entries)],
        }
        for printed in PUBLISHED_TABLES
    ]
    return {
        "as_published": as_published,
        "light": light,
        "tables": tables,
        "figures": figures,
        "errata": [_erratum(erratum) for erratum in errata()],
    }


def thinned(document: dict[str, Any]) -> dict[str, Any]:
    """Return a document reduced to the idle periods that are printed, in steps of 5 %."""

    def thin(parts: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
        return [
            part | {key: [r for r in part[key] if r["idle_percent"] % STEP_PERCENT == 0]}
            for part in parts
        ]

    tables, figures = document["tables"], document["figures"]
    return document | {"tables": thin(tables, "rows"), "figures": thin(figures, "points")}


def _row(entry: Row) -> dict[str, Any]:
    spread = entry.ratio_range
    return {
        "idle_percent": entry.idle_percent,
        "h1_hz": _one_or_list(entry.h1_hz),
        "h2_hz": _one_or_list(entry.h2_hz),
        "amplitude_ratio": entry.amplitude_ratio,
        "amplitude_ratio_range": spread and [r if math.isfinite(r) else None for r in spread],
    }


def _one_or_list(freq_hz: tuple[float, ...]) -> float | list[float] | None:
    """Return a number; a list if lines tie; None without a line."""
    rounded = [round(hz, 6) for hz in freq_hz]
    return rounded if len(rounded) > 1 else rounded[0] if rounded else None


def _point(point: IdlePoint) -> dict[str, Any]:
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


def _percents(step_percent: int) -> range:
    return range(0, 96, step_percent)


def simulated_s(step_percent: int) -> float:
    """Return how many seconds :func:`tables_document` simulates."""
    return len(CASES) * len(_percents(step_percent)) * DURATION_S


WIDTH = 96
_NONE = "–"
ROW_HEADS = ("idle %", "H1 Hz", "H2 Hz", "H1/H2", "over the light's phase")
POINT_HEADS = (
    "idle %", "model Hz", "amplitude", "range", "simulated Hz", "amplitude", "model at its phase",
)  # fmt: skip


def tables_text(document: dict[str, Any]) -> str:
    """Return the whole document as text."""
    published = document["as_published"]
    light = "as published" if published else f"{document['light']} light"
    parts = []
    for table in document["tables"]:
        cells = [_row_cells(row, published) for row in table["rows"]]
        parts += [f"Idle table, {_case(table)} ({light})", _aligned(ROW_HEADS, cells), ""]
    for figure in document["figures"]:
        what = "|cos| light; amplitude relative to its harmonic 1"
        cells = [_point_cells(point) for point in figure["points"]]
        parts += [f"Strongest line, {_case(figure)} ({what})", _aligned(POINT_HEADS, cells), ""]
    errata = (_erratum_text(n, erratum) for n, erratum in enumerate(document["errata"], 1))
    return "\n".join([*parts, "Where the paper is wrong (H1 | H2 | H1/H2)", *errata])


def tables_csv(document: dict[str, Any]) -> dict[str, str]:
    """Return the document's tables as CSV texts by file name; tied lines share a cell."""
    kinds = (("idle_table", "tables", "rows"), ("strongest_line", "figures", "points"))
    return {
        f"{kind}_{part['frame_rate_hz']:g}fps_{part['nominal_hz']:g}hz.csv": _csv(part[rows])
        for kind, parts, rows in kinds
        for part in document[parts]
    }


def _case(part: dict[str, Any]) -> str:
    return f"{part['frame_rate_hz']:g} fps on a {part['nominal_hz']:g} Hz grid"


def _row_cells(row: dict[str, Any], published: bool) -> list[str]:
    return [f"{row['idle_percent']}", _hz(row["h1_hz"]), _hz(row["h2_hz"]),
            _ratio(row, published), _range(row["amplitude_ratio_range"])]  # fmt: skip


def _ratio(row: dict[str, Any], published: bool) -> str:
    ratio = row["amplitude_ratio"]
    return "∞" if ratio is None else f"{ratio:.1f}" if published else f"{ratio:.4g}"


def _point_cells(point: dict[str, Any]) -> list[str]:
    spread = _range(point["model_amplitude_range"])
    there = f"{point['model_at_phase_hz']:.2f}  {point['model_at_phase_amplitude']:.3f}"
    return [
        f"{point['idle_percent']}",
        f"{point['model_hz']:.2f}",
        f"{point['model_amplitude']:.3f}",
        spread,
        f"{point['simulated_hz']:.2f}",
        f"{point['simulated_amplitude']:.3f}",
        there if spread else "",
    ]


def _hz(value: float | Sequence[float] | None) -> str:
    if value is None:
        return _NONE
    return ", ".join(f"{hz:g}" for hz in (value if isinstance(value, list) else [value]))


def _range(low_high: Sequence[float | None] | None) -> str:
    """Return the range over the light's phase; '' if the phase doesn't matter."""
    if low_high is None:
        return ""
    low, high = ("∞" if end is None else f"{end:.3g}" for end in low_high)
    return "" if low == high else f"{low}–{high}"


def _aligned(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Right-align columns; leave out empty ones."""
    lines = [head, *rows]
    kept = [c for c in range(len(head)) if any(line[c] for line in lines[1:])]
    wide = [max(len(line[c]) for line in lines) for c in kept]
    return "\n".join(
        "  " + "   ".join(line[c].rjust(w) for c, w in zip(kept, wide, strict=True)).rstrip()
        for line in lines
    )


def _erratum_text(number: int, erratum: dict[str, Any]) -> str:
    lines = [f"{number:2}. {erratum['where']}"]
    for word, key in (("printed", "published"), ("right", "right")):
        head = f"    {word:9}"
        lines += textwrap.wrap(
            erratum[key], WIDTH, initial_indent=head, subsequent_indent=" " * len(head)
        )
    for entry in erratum["entries"]:
        place = f"{entry['frame_rate_hz']:>5g} fps {entry['idle_percent']:>2} %"
        printed = _entry(entry["published"], True)
        lines.append(f"      {place}   {printed:22} → {_entry(entry['right'], False)}")
    return "\n".join(lines)


def _entry(row: dict[str, Any], published: bool) -> str:
    _, *cells, spread = _row_cells(row, published)
    return " | ".join(cells) + (f" ({spread})" if spread else "")


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows[0])
    for row in rows:
        writer.writerow(_cell(value) for value in row.values())
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, list):
        return " ".join("inf" if v is None else f"{v:.6g}" for v in value)
    return "" if value is None else value
