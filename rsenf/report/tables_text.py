"""The document of ``rsenf tables`` as text and CSV: idle tables, figure and errata."""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Iterable, Sequence
from typing import Any

WIDTH = 96
_NONE = "–"


def tables_text(document: dict[str, Any]) -> str:
    """Return the whole document as text."""
    published = document["as_published"]
    light = "as published" if published else f"{document['light']} light"
    parts = []
    for table in document["tables"]:
        parts.append(
            f"Idle table, {_case(table)} ({light})\n"
            + _aligned(
                ("idle %", "H1 Hz", "H2 Hz", "H1/H2", "over the light's phase"),
                (_row_cells(row, published) for row in table["rows"]),
            )
        )
    for figure in document["figures"]:
        parts.append(
            f"Strongest line, {_case(figure)} (|cos| light; amplitude relative to its harmonic 1)\n"
            + _aligned(
                ("idle %", "model Hz", "amplitude", "range", "simulated Hz", "amplitude",
                 "model at its phase"),
                (_point_cells(point) for point in figure["points"]),
            )
        )  # fmt: skip
    parts.append("Where the paper is wrong (H1 | H2 | H1/H2)\n" + "\n".join(
        _erratum(n, erratum) for n, erratum in enumerate(document["errata"], 1)
    ))  # fmt: skip
    return "\n\n".join(parts)


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
    ratio = row["amplitude_ratio"]
    written = "∞" if ratio is None else f"{ratio:.1f}" if published else f"{ratio:.4g}"
    return [f"{row['idle_percent']}", _hz(row["h1_hz"]), _hz(row["h2_hz"]), written,
            _range(row["amplitude_ratio_range"])]  # fmt: skip


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


def _erratum(number: int, erratum: dict[str, Any]) -> str:
    lines = [f"{number:2}. {erratum['where']}"]
    for word, key in (("printed", "published"), ("right", "right")):
        head = f"    {word:9}"
        lines += textwrap.wrap(
            erratum[key], WIDTH, initial_indent=head, subsequent_indent=" " * len(head)
        )
    for entry in erratum["entries"]:
        place = f"{entry['frame_rate_hz']:>5g} fps {entry['idle_percent']:>2} %"
        printed = _entry(entry["published"], ".1f")
        lines.append(f"      {place}   {printed:22} → {_entry(entry['right'], '.4g')}")
    return "\n".join(lines)


def _entry(row: dict[str, Any], digits: str) -> str:
    ratio, spread = row["amplitude_ratio"], _range(row["amplitude_ratio_range"])
    written = "∞" if ratio is None else format(ratio, digits)
    text = f"{_hz(row['h1_hz'])} | {_hz(row['h2_hz'])} | {written}"
    return f"{text} ({spread})" if spread else text


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
