"""Records of a foreign camera to rates by cell, kind, frame rate and grid; their picture."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.bench.clip_tables import relative_errors
from rsenf.bench.tables import (
    NONE,
    SOME,
    Column,
    Table,
    grouped,
    mean,
    median,
    percent,
    picture,
    rms,
    shown,
    table_of,
    titled,
)

WHOLE = ("coding", "mains")
CELL = (*WHOLE, "kind", "frame_rate", "nominal_hz", "grid")
KIND = ("coding", "kind")
PLACE = (*WHOLE, "frame_rate", "nominal_hz", "grid")
# Limits of every cell: z of raw and coded cases, and z of an estimate that is far off.
MOST_Z, MOST_Z_CODED, FAR_STDS = 2.0, 2.5, 10.0
SHOWN = 60  # most cells beyond the limits in the text; the JSON has all


def tabulated(records: Sequence[Record]) -> dict[str, Any]:
    """Return the rates of each method in all, by kind, by frame rate and grid, and by cell."""
    known = [r | {"coding": "coded" if r["coding"] != "raw" else "raw"} for r in records]
    rows = _rows(known, CELL)
    beyond = sorted((row for row in rows if _beyond(row)), key=_badness, reverse=True)
    methods = _rows(known, WHOLE)
    for method in methods:
        for name, cells in (("cells", rows), ("cells_beyond", beyond)):
            fields = (*WHOLE, "of", "method")
            method[name] = sum(all(cell[f] == method[f] for f in fields) for cell in cells)
    return {
        "records": len(records),
        "seeds": sorted({r["seed"] for r in records}),
        "versions": sorted({r["versions"]["source"] for r in records}),
        "methods": methods,
        "kinds": _rows(known, KIND),
        "codings": _rows([r for r in records if r["coding"] != "raw"], ("coding",)),
        "places": _rows(known, PLACE),
        "rows": rows,
        "beyond": beyond,
    }


def _rows(records: Iterable[Record], by: Sequence[str]) -> list[dict[str, Any]]:
    """Return a row for each group of records and method, in order."""
    return [
        group | (_enf if group["of"] == "enf" else _idle)(found)
        for group, found in grouped(records, *by, "of", "method")
    ]


def _enf(records: Sequence[Record]) -> dict[str, Any]:
    """Return rates of an ENF method: errors in mHz over the usable seconds with a mains light."""
    lit, common = _common(records)
    errors = [e for f in lit for e in f.get("error_mhz", ()) if e is not None]
    relative = [e for f in lit if "error_mhz" in f for e in relative_errors(f).tolist()]
    seconds = sum(r["duration_s"] for r in records if r["mains"])
    return {
        **common,
        "usable_ratio": len(errors) / seconds if seconds else None,
        **_accuracy(errors, relative, [abs(z) <= 1.96 for z in relative]),
        "turned": 0,
        "false_claims": sum(not r["mains"] and bool(r["found"].get("t_s")) for r in records),
        "false_seconds": sum(len(r["found"].get("t_s", ())) for r in records if not r["mains"]),
    }


def _idle(records: Sequence[Record]) -> dict[str, Any]:
    """Return rates of an idle method: errors in percentage points where it gives an estimate."""
    lit, common = _common(records)
    estimates = [
        f for f in lit if f.get("verdict") == "estimated" and f["error_percent"] is not None
    ]
    relative = [z for f in estimates for z in relative_errors(f).tolist()]
    inside = [f["inside"] for f in estimates if f["inside"] is not None]
    return {
        **common,
        "usable_ratio": len(estimates) / len(lit) if lit else None,
        **_accuracy([f["error_percent"] for f in estimates], relative, inside),
        "turned": sum(f["turned"] for f in estimates),
        "false_claims": sum(
            not r["mains"] and r["found"].get("verdict") == "estimated" for r in records
        ),
        "false_seconds": 0,
    }


def _accuracy(
    errors: Sequence[float], relative: Sequence[float], inside: Sequence[bool]
) -> dict[str, Any]:
    """Return statistics of errors, of errors over standard errors, and of intervals."""
    return {
        "median": median([abs(error) for error in errors]),
        "rms": rms(errors),
        "z": rms(relative),
        "far": sum(abs(z) > FAR_STDS for z in relative),
        "inside_ratio": mean(inside),
    }


def _common(records: Sequence[Record]) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    found = [r["found"] for r in records]
    return [r["found"] for r in records if r["mains"]], {
        "cases": len(records),
        "broke": sum("broke" in f for f in found),
        "cpu_s": mean([f["cpu_s"] for f in found if "cpu_s" in f]),
    }


def _beyond(row: dict[str, Any]) -> bool:
    """Whether a cell is beyond a limit."""
    most = MOST_Z if row["coding"] == "raw" else MOST_Z_CODED
    return bool((row["z"] or 0.0) > most or row["far"] or row["false_claims"])


def _badness(row: dict[str, Any]) -> tuple[float, float]:
    return row["false_claims"], row["z"] or 0.0


def text(document: dict[str, Any], *, on_page: bool = False) -> str:
    """Write the tables for a terminal, or in Markdown for a page."""
    whole: list[Column] = [
        ("cases", lambda row: " ".join(_words(row, WHOLE))),
        ("cells beyond", lambda row: f"{row['cells_beyond']} of {row['cells']}"),
        *_COLUMNS,
    ]
    tables = [table_of("methods", whole, document["methods"])]
    for of in ("enf", "idle"):
        tables.append(_matrix(f"{of} by kind", _of(document["kinds"], of), KIND))
        tables.append(_matrix(f"{of} by coding", _of(document["codings"], of), ("coding",)))
        tables.append(_matrix(f"{of} by frame rate and grid", _of(document["places"], of), PLACE))
    beyond = document["beyond"]
    cell: Column = ("cell", lambda row: " ".join(_words(row, CELL)))
    title = f"beyond the marks: {len(beyond)} of {len(document['rows'])} cells"
    tables.append(table_of(title, [cell, *_COLUMNS], beyond[:SHOWN]))
    seeds = document["seeds"]
    origin = f"seeds {seeds[0]} to {seeds[-1]}" if seeds else "nothing measured"
    made = len(document["versions"])
    origin += f"; made by {made} versions of the program" if made > 1 else ""
    return titled(tables, [f"{_NOTE}\n{origin}"], on_page=on_page)


_NOTE = f"""\
median, rms: of errors, mHz over the usable seconds, or points of the frame period; z: rms of errors
over stated standard errors, 1 where they are honest; far: more than {FAR_STDS:g} of them off;
within 95 %: of the intervals; turned: read-out direction wrong; false: a usable second, or an idle
period, where there is no mains light. By kind, and by frame rate and grid: rms, z, share usable.
A cell of one kind, frame rate and grid is beyond the marks where z is over {MOST_Z:g} (coded
{MOST_Z_CODED:g}), or something is far off or false."""


def _matrix(title: str, rows: Sequence[dict[str, Any]], by: Sequence[str]) -> Table:
    """Return a table with a line for each group and a column for each method."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    lines: dict[tuple[Any, ...], dict[str, str]] = {}
    for row in rows:
        words = tuple(_words(row, by))
        lines.setdefault(words, {})[row["method"]] = _brief(row)
    body = [[" ".join(words), *(of.get(m, "") for m in methods)] for words, of in lines.items()]
    return title, ("cases", *methods), sorted(body)


def _words(row: dict[str, Any], by: Sequence[str]) -> list[str]:
    words = []
    for field in by:
        value = row[field]
        if field == "mains":
            words.append("" if value else "no lamp")
        elif field == "nominal_hz":
            words.append(f"{value:g} Hz")
        elif field == "frame_rate":
            words.append(f"{value} fps")
        else:
            words.append(str(value))
    return [word for word in words if word]


def _brief(row: dict[str, Any]) -> str:
    if row["usable_ratio"] is None:
        return f"{row['false_claims']} false of {row['cases']}"
    if not row["usable_ratio"]:
        return NONE
    far = f", {row['far']} far" if row["far"] else ""
    return f"{shown(row['rms'])}, z {shown(row['z'])}, {percent(row['usable_ratio'], '.0f')}{far}"


def _of(rows: Sequence[dict[str, Any]], of: str) -> list[dict[str, Any]]:
    return [row for row in rows if row["of"] == of]


_COLUMNS: tuple[Column, ...] = (
    ("of", "of"), ("method", "method"), ("cases", "cases"), ("usable", "usable_ratio", ".0f %"),
    ("median", "median", ".3g"), ("rms", "rms", ".3g"), ("z", "z", ".3g"), ("far", "far", SOME),
    ("within 95 %", "inside_ratio", ".0f %"), ("turned", "turned", SOME),
    ("false", "false_claims", SOME), ("seconds", "false_seconds", SOME), ("broke", "broke", SOME),
    ("CPU", lambda r: "" if r["cpu_s"] is None else f"{r['cpu_s']:.2f} s"),
)  # fmt: skip


LEAST_Z, FARTHEST_Z = 0.1, 10.0


def draw(path: Path, document: dict[str, Any]) -> None:
    """Draw z of the first ENF and the first idle method into a PNG file.

    Rows are kinds and codings, columns frame rates and grids. White: z is 1; red: standard errors
    too small; blue: too large. A dash: no estimate; a cross: a false claim."""
    rows = document["rows"]
    first = {of: next((r["method"] for r in rows if r["of"] == of), "") for of in ("enf", "idle")}
    drawn = {of: method for of, method in first.items() if method}
    kinds = list(dict.fromkeys((r["kind"], r["coding"]) for r in rows))
    places = sorted(
        {(r["frame_rate"], r["nominal_hz"]) for r in rows}, key=lambda p: (p[1], Fraction(p[0]))
    )
    size = (2.5 + 0.42 * len(places) * max(len(drawn), 1), 2.0 + 0.26 * len(kinds))
    with picture(path, size) as figure:
        panels = figure.subplots(1, max(len(drawn), 1), sharey=True, squeeze=False)[0]
        for axes, (of, method) in zip(panels, drawn.items(), strict=False):
            square, count = np.zeros((len(kinds), len(places))), np.zeros((len(kinds), len(places)))
            for row in rows:
                if (row["of"], row["method"]) != (of, method):
                    continue
                at = (
                    kinds.index((row["kind"], row["coding"])),
                    places.index((row["frame_rate"], row["nominal_hz"])),
                )
                if row["z"] is not None:
                    square[at] += row["z"] ** 2
                    count[at] += 1
                else:
                    mark = "×" if row["false_claims"] else "–"
                    axes.text(at[1], at[0], mark, ha="center", va="center", color="#c23b22")
            z = np.sqrt(np.divide(square, count, out=np.full_like(square, np.nan), where=count > 0))
            axes.set_facecolor("#d8d8d8")
            image = axes.imshow(
                np.log10(np.clip(z, LEAST_Z, FARTHEST_Z)), cmap="RdBu_r", vmin=np.log10(LEAST_Z),
                vmax=np.log10(FARTHEST_Z), aspect="auto",
            )  # fmt: skip
            for at_row, at_column in zip(*np.nonzero(z > FARTHEST_Z), strict=True):
                axes.text(
                    at_column, at_row, f"{z[at_row, at_column]:.0f}", ha="center", va="center",
                    color="white", fontsize="x-small",
                )  # fmt: skip
            axes.set_title(f"{of}, {method}", loc="left", fontsize="medium")
            names = [f"{rate} fps, {hz:g} Hz" for rate, hz in places]
            axes.set_xticks(range(len(places)), names, rotation=70, ha="right", fontsize="x-small")
            labels = [kind if coding == "raw" else f"{kind}, {coding}" for kind, coding in kinds]
            axes.set_yticks(range(len(kinds)), labels, fontsize="x-small")
        if drawn:
            bar = figure.colorbar(
                image, ax=panels.tolist(), label="rms of errors over stated errors"
            )
            ticks = [0.1, 0.3, 0.6, 1.0, 1.7, 3.0, 10.0]
            bar.set_ticks(np.log10(ticks).tolist(), labels=[f"{tick:g}" for tick in ticks])
