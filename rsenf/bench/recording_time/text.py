"""The tables as text and as Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from rsenf.bench.recording_time.trials import METHODS, PAPER_METRICS
from rsenf.bench.tables import NONE, Row, Table, made_from, percent, shown, titled

_NOTE = """\
TD/FD/ND: decisions that are true (within 1 s), false, and none, per cent of the trials.
absent: the day of the film without 10 minutes on either side of it, and a day of another year;
any match there is false. bound: the rate that so few refute with 95 % confidence, were the trials
independent; those of one film aren't quite. Clips are cut from films that were encoded whole."""


def text(document: Row, *, on_page: bool = False) -> str:
    """Return the tables of :func:`rsenf.bench.recording_time.table.tabulated`."""
    made = made_from(
        document,
        "films",
        f"grid: {', '.join(document['grids'])}",
        "reference: " + ", ".join(f"{h:g} h" for h in document["references_h"]),
        "its noise: " + ", ".join(f"{n:g} mHz" for n in document["noise_mhz"]),
    )
    return titled(_tables(document), [_NOTE, made], on_page=on_page)


def _tables(document: Row) -> Iterator[Table]:
    yield _decisions(document["rows"], document["published"])
    yield _false(document["absent"])
    yield _marks(document["marks"])
    yield _order(document["order"])
    yield _recovery(document["recovery"])
    yield _evidence(document["evidence"])


def _decisions(rows: Sequence[Row], published: Sequence[Row]) -> Table:
    """Return decisions, a line for each cell, a column for each method; and the paper's."""
    methods = [m for m in METHODS if any(row["method"] == m for row in rows)]
    cells: dict[tuple[str, str, float], dict[str, Row]] = {}
    for row in rows:
        cells.setdefault((row["kind"], row["coding"], row["length_s"]), {})[row["method"]] = row
    lines = [
        [kind, coding, f"{length_s:g} s", str(next(iter(of.values()))["present"])]
        + [_decided(of[m]) if m in of else NONE for m in methods]
        for (kind, coding, length_s), of in cells.items()
    ]
    if set(methods) & set(PAPER_METRICS):
        lines += [_as_published(p, methods) for p in published]
    head = ("film", "coding", "clip", "trials", *methods)
    return "TD/FD/ND with the true time in the reference", head, lines


def _decided(row: Row) -> str:
    broke = f" {row['broke']} broke" if row["broke"] else ""
    return "/".join(f"{row[f'{o}_percent']:.0f}" for o in ("true", "false", "none")) + broke


def _as_published(published: Row, methods: Sequence[str]) -> list[str]:
    figures = dict(
        zip(PAPER_METRICS, zip(published["true"], published["false"], strict=True), strict=True)
    )
    coding = "the paper's, coded" if published["coded"] else "the paper's originals"
    return [published["kind"], coding, "", str(published["videos"])] + [
        f"{figures[m][0]:.0f}/{figures[m][1]:.0f}/{100 - sum(figures[m]):.0f}"
        if m in figures
        else NONE
        for m in methods
    ]


def _false(rows: Sequence[Row]) -> Table:
    lines = [
        [_length(row["length_s"]), row["method"], str(row["absent"]), str(row["absent_false"]),
         _per_cent(row["absent_false_percent"]), _per_cent(row["absent_bound_percent"])]
        for row in rows
    ]  # fmt: skip
    head = ("clip", "method", "absent", "false", "rate", "bound")
    return "False decisions with the true time absent, all films and codings", head, lines


def _marks(rows: Sequence[Row]) -> Table:
    words = {True: "yes", False: "no", None: NONE}
    lines = [
        [row["mark"], _per_cent(row["percent"]), str(row["trials"]),
         _per_cent(row["found_percent"]), words[row["reached"]]]
        for row in rows
    ]  # fmt: skip
    return "Marks of the default method", ("mark", "limit", "trials", "found", "reached"), lines


def _order(rows: Sequence[Row]) -> Table:
    lines = [
        [row["kind"], row["coded"], _length(row["length_s"]), str(row["trials"]),
         *map(str, row["true"]), "/".join(map(str, row["false"])), "yes" if row["holds"] else "no"]
        for row in rows
    ]  # fmt: skip
    head = ("film", "coding", "clip", "trials", *PAPER_METRICS, "false", "each ≥ those before")
    held = sum(row["holds"] for row in rows)
    return f"True decisions of Metrics 1 to 4: in order in {held} of {len(rows)} cells", head, lines


def _recovery(rows: Sequence[Row]) -> Table:
    lines = [
        [row["coding"], _length(row["length_s"]), row["method"], str(row["trials"]),
         shown(row["lag_rms_s"]), shown(row["lag_std_s"]), percent(row["lag_within"], ".0f"),
         shown(row["clock_rms_ppm"]), shown(row["clock_std_ppm"]),
         percent(row["clock_within"], ".0f")]
        for row in rows
    ]  # fmt: skip
    head = ("coding", "clip", "method", "true", "lag rms s", "said", "within 2 std",
            "clock rms ppm", "said", "within 2 std")  # fmt: skip
    return "Lag and clock error of the true decisions", head, lines


def _evidence(rows: Sequence[Row]) -> Table:
    lines = [
        [row["method"], row["question"], _edge(row["from"]), _edge(row["to"]), str(row["trials"]),
         str(row["right"]), percent(row["right"] / row["trials"], ".0f")]
        for row in rows
    ]  # fmt: skip
    head = ("method", "against", "log10 LR from", "to", "trials", "best is true", "share")
    return "What a likelihood ratio was worth", head, lines


_per_cent = partial(shown, unit=" %")  # of percentages


def _length(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g} s"


def _edge(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
