"""Tables of every benchmark, aligned or in Markdown, and pictures."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rsenf.bench.statistics import Row
from rsenf.report.panels import new_figure, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = tuple[str, Sequence[str], list[list[str]]]  # title, head, lines
# Heading; field of a row, or a function of the row; format of a field.
Column = tuple[str, str | Callable[[Row], str]] | tuple[str, str, str]
SOME = "some"  # format: nothing for zero
SCALES = {"%": 100.0, "ms": 1e3}  # of a ratio, and of seconds, by unit
NONE = "–"


def made_from(document: Row, what: str, *details: str) -> str:
    """Return a line on the records behind a table; ``details`` if there are any records."""
    parts, seeds = [f"{what}: {document[what]}"], document["seeds"]
    if seeds:
        parts += [f"seeds {seeds[0]} to {seeds[-1]}", *details]
    if len(document["versions"]) > 1:
        parts.append(f"made by {len(document['versions'])} versions of the program")
    return "; ".join(parts)


def shown(value: float | None, form: str = ".3g") -> str:
    """Return a number for a cell, with a unit after a space, as of :data:`SCALES`.

    >>> shown(0.12345), shown(2.0, ".0f s"), shown(0.5, ".0f %"), shown(None)
    ('0.123', '2 s', '50 %', '–')
    """
    number, space, unit = form.partition(" ")
    if value is None:
        return NONE
    return f"{SCALES[unit] * value if unit in SCALES else value:{number}}{space}{unit}"


def table_of(title: str, columns: Sequence[Column], rows: Iterable[Row]) -> Table:
    """Return a table with a line for each row.

    >>> table_of("", [("of", "n"), ("share", "r", ".0f %"), ("took", "t", ".1f s")],
    ...          [{"n": 3, "r": 0.5, "t": 2.0}])
    ('', ['of', 'share', 'took'], [['3', '50 %', '2.0 s']])
    """
    return title, [c[0] for c in columns], [[_cell(row, *c[1:]) for c in columns] for row in rows]


def _cell(row: Row, of: str | Callable[[Row], str], form: str = "") -> str:
    if callable(of):
        return of(row)
    if form in ("", SOME):
        return str(row[of] or "") if form else str(row[of])
    return shown(row[of], form)


def by_method(
    title: str, columns: Sequence[Column], brief: Callable[[Row], str], rows: Iterable[Row]
) -> Table:
    """Return a table with a column for each method, after the given ones.

    Parameters
    ----------
    brief : callable
        From a row to the text in its method's column.
    """
    lines: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        line = lines.setdefault(tuple(_cell(row, *c[1:]) for c in columns), {})
        line[row["method"]] = brief(row)
    methods = list(dict.fromkeys(method for line in lines.values() for method in line))
    cells = [[*key, *(line.get(m, NONE) for m in methods)] for key, line in lines.items()]
    return title, [*(column[0] for column in columns), *methods], cells


def written(table: Table, *, on_page: bool) -> str:
    """Return a table without its title and its empty columns, aligned or in Markdown."""
    _, head, rows = table
    kept = [c for c in range(len(head)) if any(row[c] not in ("", NONE) for row in rows)]
    lines = [[line[c] for c in kept] for line in (head, *rows)]
    if on_page:
        lines.insert(1, ["---"] * len(kept))
        return "\n".join(f"| {' | '.join(line)} |" for line in lines)
    wide = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.rjust(w) for cell, w in zip(line, wide, strict=True)).rstrip()
        for line in lines
    )


def titled(tables: Iterable[Table], notes: Sequence[str], *, on_page: bool) -> str:
    """Return the tables with rows under their titles, and notes, as text or in Markdown."""
    heading = "**{}**" if on_page else "{}"
    parts = [f"{heading.format(t[0])}\n\n{written(t, on_page=on_page)}" for t in tables if t[2]]
    return "\n\n".join([*parts, *notes])


@contextmanager
def picture(path: Path, size_inch: tuple[float, float]) -> Iterator[Figure]:
    """Give a figure to draw on, and write it as a PNG file, at 110 pixels an inch."""
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    figure = new_figure(*size_inch)
    yield figure
    save(figure, path)
