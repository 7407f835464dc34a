"""Estimators on a foreign camera: one method on one case; rates by cell, kind, rate and grid."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from rsenf.batch.journal import Record
from rsenf.bench.clip_tables import estimated, relative_errors
from rsenf.bench.foreign import NEEDED, RAW, ForeignCase, camera_at
from rsenf.bench.harness import BenchRun, Made, Tasks, known_names
from rsenf.bench.measure import decoded, enf_by, idle_by, versions
from rsenf.bench.statistics import grouped, mean, median, origin_of, rms
from rsenf.bench.tables import NONE, SOME, Column, by_method, made_from, shown, table_of, titled
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.messages import Header
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import METHODS as ENF_METHODS

COLUMNS = 426  # width of an encoded picture
WHOLE = ("coding", "mains")
PLACE = (*WHOLE, "frame_rate", "nominal_hz", "grid")
CELL = (*WHOLE, "kind", "frame_rate", "nominal_hz", "grid")
KIND = ("coding", "kind")
# Limits of every cell: z of raw and coded cases, and z of an estimate that is far off.
MOST_Z, MOST_Z_CODED, FAR_STDS = 2.0, 2.5, 10.0
SHOWN = 60  # most cells beyond the limits in the text; the JSON has all
_NOTE = f"""\
median, rms: of errors, mHz over the usable seconds, or points of the frame period; z: rms of errors
over stated standard errors, 1 where they are honest; far: more than {FAR_STDS:g} of them off;
within 95 %: of the intervals; turned: read-out direction wrong; false: a usable second, or an idle
period, where there is no mains light. By kind, and by frame rate and grid: rms, z, share usable.
A cell of one kind, frame rate and grid is beyond the marks where z is over {MOST_Z:g} (coded
{MOST_Z_CODED:g}), or something is far off or false."""


def _tasks_of(cases: Sequence[ForeignCase], methods: Sequence[str]) -> Tasks:
    """Return every ENF and idle method, or those named, on each case, by the key of its record."""
    known = [("enf", name) for name in ENF_METHODS] + [("idle", name) for name in IDLE_METHODS]
    known_names(methods, [name for _, name in known], "method")
    return {
        f"{of} {method}: {case.key}": (case, of, method)
        for case in cases
        for of, method in known
        if not methods or method in methods
    }


def _tried(case: ForeignCase, of: str, method: str, path: Path) -> dict[str, Any]:
    """Run a method on a case of the camera at a path; return its record, of plain values.

    ``of`` is ``enf`` or ``idle``.
    """
    filmed, blocks = _filmed(case, path)
    ratios, direction = filmed.truth["idle_ratios"], filmed.truth["direction"]
    if of == "enf":
        found = enf_by(method, blocks, filmed)
    else:
        found = idle_by(method, blocks, ratios[0])
        if (idle_percent := found.get("idle_percent")) is not None:
            true = min((100 * ratio for ratio in ratios), key=lambda one: abs(idle_percent - one))
            low, high = found["interval_percent"]
            found["error_percent"] = idle_percent - true
            found["inside"] = None if low is None or high is None else low <= true <= high
            found["turned"] = found["direction"] not in ("", direction)
    return {**asdict(case), "of": of, "method": method, "found": found, "versions": versions()}


@functools.lru_cache(maxsize=1)
def _filmed(case: ForeignCase, path: Path) -> tuple[Any, list[Any]]:
    """Simulate a case, once for consecutive methods."""
    camera = camera_at(path, NEEDED)
    drawn = camera.trial(
        case.kind, case.seed, rate=case.frame_rate, nominal_hz=case.nominal_hz, grid=case.grid,
        duration_s=case.duration_s,
    )  # fmt: skip
    if case.coding == RAW:
        filmed = camera.film(drawn)
        return filmed, list(blocks_from_luminance(filmed.level, filmed.stamp_s, Header()))
    with tempfile.TemporaryDirectory(prefix="rsenf-foreign-") as folder:
        file = Path(folder) / "film.mp4"
        camera.as_video(drawn, file, columns=COLUMNS, coding=case.coding)
        return camera.film(camera.video_case(drawn)), decoded(file)


def _tabulated(records: Sequence[Record]) -> dict[str, Any]:
    known = [r | {"coding": "coded" if r["coding"] != "raw" else "raw"} for r in records]
    rows = _rows(known, CELL)
    beyond = sorted(
        filter(_beyond, rows), key=lambda row: (row["false_claims"], row["z"] or 0.0), reverse=True
    )
    methods = _rows(known, WHOLE)
    for method in methods:
        for name, cells in (("cells", rows), ("cells_beyond", beyond)):
            fields = (*WHOLE, "of", "method")
            method[name] = sum(all(cell[f] == method[f] for f in fields) for cell in cells)
    return {
        "records": len(records),
        **origin_of(records),
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
        group | _row(group["of"], found) for group, found in grouped(records, *by, "of", "method")
    ]


def _row(of: str, records: Sequence[Record]) -> dict[str, Any]:
    """Return rates of a method; errors are in mHz (ENF), or in percentage points (idle period)."""
    found = [r["found"] for r in records]
    lit = [r["found"] for r in records if r["mains"]]
    dark = [r["found"] for r in records if not r["mains"]]
    if of == "enf":
        judged = [f for f in lit if "error_mhz" in f]
        errors = [e for f in judged for e in f["error_mhz"] if e is not None]
        possible = sum(r["duration_s"] for r in records if r["mains"])
        claims = [len(f.get("t_s", ())) for f in dark]
    else:
        judged = estimated(lit)
        errors = [f["error_percent"] for f in judged]
        possible = len(lit)
        claims = [f.get("verdict") == "estimated" for f in dark]
    relative = [z for f in judged for z in relative_errors(f).tolist()]
    intervals = [f["inside"] for f in judged if f.get("inside") is not None]
    return {
        "cases": len(records),
        "broke": sum("broke" in f for f in found),
        "cpu_s": mean([f["cpu_s"] for f in found if "cpu_s" in f]),
        "usable_ratio": len(errors) / possible if possible else None,
        "median": median([abs(error) for error in errors]),
        "rms": rms(errors),
        "z": rms(relative),
        "far": sum(abs(z) > FAR_STDS for z in relative),
        "inside_ratio": mean([abs(z) <= 1.96 for z in relative] if of == "enf" else intervals),
        "turned": sum(f.get("turned", False) for f in judged),
        "false_claims": sum(map(bool, claims)),
        "false_seconds": sum(claims) if of == "enf" else 0,
    }


def _beyond(row: dict[str, Any]) -> bool:
    most = MOST_Z if row["coding"] == "raw" else MOST_Z_CODED
    return bool((row["z"] or 0.0) > most or row["far"] or row["false_claims"])


def _text(document: dict[str, Any], *, on_page: bool = False) -> str:
    whole: tuple[Column, ...] = (
        ("cases", partial(_words, by=WHOLE)),
        ("cells beyond", lambda row: f"{row['cells_beyond']} of {row['cells']}"),
    )
    tables = [table_of("methods", (*whole, *_COLUMNS), document["methods"])]
    by = (("kind", "kinds", KIND), ("coding", "codings", ("coding",)),
          ("frame rate and grid", "places", PLACE))  # fmt: skip
    for of, (what, field, fields) in product(("enf", "idle"), by):
        rows = [row for row in document[field] if row["of"] == of]
        cases: Column = ("cases", partial(_words, by=fields))
        title, head, lines = by_method(f"{of} by {what}", [cases], _brief, rows)
        tables.append((title, head, sorted(lines)))
    beyond, cell = document["beyond"], ("cell", partial(_words, by=CELL))
    title = f"beyond the marks: {len(beyond)} of {len(document['rows'])} cells"
    tables.append(table_of(title, [cell, *_COLUMNS], beyond[:SHOWN]))
    return titled(tables, [f"{_NOTE}\n{made_from(document, 'records')}"], on_page=on_page)


def _words(row: dict[str, Any], by: Sequence[str]) -> str:
    said = {
        "mains": "" if row.get("mains", True) else "no lamp",
        "nominal_hz": f"{row.get('nominal_hz', 0.0):g} Hz",
        "frame_rate": f"{row.get('frame_rate')} fps",
    }
    return " ".join(filter(None, (said.get(field, row[field]) for field in by)))


def _brief(row: dict[str, Any]) -> str:
    if row["usable_ratio"] is None:
        return f"{row['false_claims']} false of {row['cases']}"
    if not row["usable_ratio"]:
        return NONE
    far = f", {row['far']} far" if row["far"] else ""
    return f"{shown(row['rms'])}, z {shown(row['z'])}, {shown(row['usable_ratio'], '.0f %')}{far}"


_COLUMNS: tuple[Column, ...] = (
    ("of", "of"), ("method", "method"), ("cases", "cases"), ("usable", "usable_ratio", ".0f %"),
    ("median", "median", ".3g"), ("rms", "rms", ".3g"), ("z", "z", ".3g"), ("far", "far", SOME),
    ("within 95 %", "inside_ratio", ".0f %"), ("turned", "turned", SOME),
    ("false", "false_claims", SOME), ("seconds", "false_seconds", SOME), ("broke", "broke", SOME),
    ("CPU", lambda r: "" if r["cpu_s"] is None else f"{r['cpu_s']:.2f} s"),
)  # fmt: skip


def measure(run: BenchRun) -> Made:
    """Run every method on every case; the table has the methods of the options alone."""
    path = run.options.camera.absolute()
    tasks = _tasks_of(run.settings().cases(camera_at(path, NEEDED)), run.options.methods)
    records = run.records(tasks, partial(_tried, path=path), "estimators.jsonl", "cases")
    methods = {method for _, _, method in tasks.values()}
    return Made(_tabulated([r for r in records if r["method"] in methods]), _text)
