"""The benchmarks of clips: what they measure, and their tables as text and as Markdown."""

from __future__ import annotations

from functools import partial

from rsenf.bench import BENCHMARKS, cameras_table
from rsenf.bench.clip_tables import PAPER_AVERAGE_ERROR_PERCENT, VERDICTS, tabulated
from rsenf.bench.harness import Made, Run
from rsenf.bench.measure import measure as measure_clip
from rsenf.bench.plan import Plan
from rsenf.bench.tables import (
    NONE,
    Column,
    Row,
    by_method,
    made_from,
    percent,
    shown,
    table_of,
    written,
)

_ZERO = """\

*: the flicker's alias at the frame rate is at 0 Hz, and the grid's drift turns it by a radian or
more; <1 rad: by less, too little to tell flicker from texture."""
_IDLE_NOTE = f"""\
Errors in percentage points of the frame period, over the clips that were estimated; est, amb, ref
and none count clips: estimated, ambiguous, refused, no signal. spread: rms of error over standard
error. bound: Cramér–Rao, uncoded. The paper, five cameras at 720p and 29.97 fps, 6 videos each:
average errors {min(PAPER_AVERAGE_ERROR_PERCENT)} to {max(PAPER_AVERAGE_ERROR_PERCENT):.2f}."""
_ENF_NOTE = """\
rms of a clip in mHz, against the grid's mean over the second around each value. usable: share of
the seconds with a value. spread: rms of error over standard error; >3σ: share of the values beyond
three. bound: Cramér–Rao of one second by itself, uncoded."""
_CLAIMS_NOTE = """\
Clips with nothing to claim. A claim is an idle ratio that was given, or one usable second of ENF.
below: the rate of claims that so few refute with 95 % confidence. right: claims within three
standard errors of the truth, where the exposure leaves some flicker; others: all but those."""


def text(document: Row, *, on_page: bool = False) -> str:
    """Return a table of :func:`rsenf.bench.clip_tables.tabulated` for a terminal or in Markdown.

    In Markdown, errors have a column for each method with median (maximum).
    """
    rows, name = document["rows"], document["table"]
    columns, note = _TEXT[name]
    table = table_of("", columns, rows)
    if on_page and name in _BRIEF:
        bound, brief = _BRIEF[name]
        clip: tuple[Column, ...] = (
            ("clip", _cell), ("coding", "coding"), ("clips", "clips"), ("bound", bound, ".3g"),
        )  # fmt: skip
        table = by_method("", clip, brief, rows)
    notes = _made_from(document) if on_page else f"{note}\n{_made_from(document)}"
    return f"{written(table, on_page=on_page)}\n\n{notes}"


def _made_from(document: Row) -> str:
    """Return one line on the clips behind a table."""
    is_zero = any(row["turned"] is not None for row in document["rows"])
    return made_from(
        document,
        "clips",
        "seconds each: " + ", ".join(f"{s:g}" for s in document["durations_s"]),
        f"grid: {', '.join(document['grids'])}",
    ) + (_ZERO if is_zero else "")


def _idle_brief(row: Row) -> str:
    missing = [f"{row[v]} {v.replace('_', ' ')}" for v in (*VERDICTS[1:], "broke") if row[v]]
    if row["median_percent"] is None:
        return ", ".join(missing) or NONE
    figures = f"{shown(row['median_percent'])} ({shown(row['worst_percent'])})"
    return "; ".join([figures, ", ".join(missing)]) if missing else figures


def _enf_brief(row: Row) -> str:
    if row["median_mhz"] is None:
        return NONE
    figures = f"{shown(row['median_mhz'])} ({shown(row['worst_mhz'])})"
    return f"{figures}, {percent(row['usable_ratio'])}"


def _cell(row: Row) -> str:
    size = f"{row['size']} " if "size" in row else ""
    zero = {None: "", True: "*", False: "*<1 rad"}[row["turned"]]
    return f"{size}{row['frame_rate']} fps {row['nominal_hz']:g} Hz{zero}"


_IDLE: tuple[Column, ...] = (
    ("cell", _cell), ("coding", "coding"), ("method", "method"), ("clips", "clips"),
    *zip(("est", "amb", "ref", "none", "broke"), (*VERDICTS, "broke"), strict=True),
    ("median", "median_percent", ".3g"), ("worst", "worst_percent", ".3g"),
    ("std", "std_percent", ".3g"), ("spread", "spread", ".3g"), ("bound", "bound_percent", ".3g"),
    ("ms/s", "cpu_ms_per_s", ".3g"),
)  # fmt: skip
_ENF: tuple[Column, ...] = (
    ("cell", _cell), ("coding", "coding"), ("method", "method"), ("clips", "clips"),
    ("with", "with_values"), ("broke", "broke"), ("usable", "usable_ratio", ".3g %"),
    ("median", "median_mhz", ".3g"), ("worst", "worst_mhz", ".3g"),
    ("std", "std_mhz", ".3g"),
    ("spread", "spread", ".3g"), (">3σ", "beyond_3_std_ratio", ".3g %"),
    ("bound", "bound_mhz", ".3g"),
    ("ms/s", "cpu_ms_per_s", ".3g"),
)  # fmt: skip
_CLAIMS: tuple[Column, ...] = (
    ("scene", "scene"), ("coding", "coding"), ("of", "kind"), ("method", "method"),
    ("clips", "clips"), ("claims", "claims"), ("below", "bound_ratio", ".3g %"), ("right", "right"),
    ("others below", "false_bound_ratio", ".3g %"), ("broke", "broke"),
    ("ms/s", "cpu_ms_per_s", ".3g"),
)  # fmt: skip
_TEXT = {
    "idle": (_IDLE, _IDLE_NOTE), "enf": (_ENF, _ENF_NOTE), "claims": (_CLAIMS, _CLAIMS_NOTE),
}  # fmt: skip
_BRIEF = {"idle": ("bound_percent", _idle_brief), "enf": ("bound_mhz", _enf_brief)}


QUICK = {"sizes": ("240p",), "frame_rates": ("25", "29.97"), "codings": ("lossless", "50k"),
         "clips": 1, "duration_s": 24.0}  # fmt: skip


def measure(run: Run) -> Made:
    """Measure the clips; those with mains light and those without are in different files."""
    options, table = run.options, run.options.table
    plan = run.settings(Plan, **(QUICK if options.quick else BENCHMARKS[table].usual))
    claims = table == "claims"
    clips, file = (plan.nothing(), "claims.jsonl") if claims else (plan.lit(), "clips.jsonl")
    records = run.records(clips, partial(measure_clip, grids=options.grids), file, "clips")
    if table == "cameras":
        fleets = cameras_table.tabulated(records, options.fleets, plan.first_seed)
        return Made(fleets, cameras_table.text)
    return Made(tabulated(table, records, pooled=getattr(options, "pool_sizes", False)), text)
