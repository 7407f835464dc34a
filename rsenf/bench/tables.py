"""Tables of every benchmark: groups of rows, statistics and bounds, layout, and pictures."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsenf.batch.journal import Record
from rsenf.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, Any]
Table = tuple[str, Sequence[str], list[list[str]]]  # title, head, lines
# Heading; field of a row, or a function of the row; format of a field.
Column = tuple[str, str | Callable[[Row], str]] | tuple[str, str, str]
SOME = "some"  # format: nothing for zero
NONE = "–"
CONFIDENCE = 0.95


def grouped(rows: Iterable[Row], *by: str) -> list[tuple[Row, list[Row]]]:
    """Return groups of rows with equal values of some fields, in order of first occurrence.

    Parameters
    ----------
    rows : iterable of dict
    *by : str
        The fields.

    Returns
    -------
    list of (dict, list of dict)
        The common values, and the rows.

    Examples
    --------
    >>> grouped([{"a": 1, "b": 2}, {"a": 1, "b": 3}], "a")
    [({'a': 1}, [{'a': 1, 'b': 2}, {'a': 1, 'b': 3}])]
    """
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in by), []).append(row)
    return [(dict(zip(by, key, strict=True)), found) for key, found in groups.items()]


def median(values: Sequence[float]) -> float | None:
    """Median; None of no values."""
    return float(np.median(values)) if len(values) else None


def mean(values: Sequence[float]) -> float | None:
    """Mean, of flags their share; None of no values."""
    return float(np.mean(values)) if len(values) else None


def worst(values: Sequence[float]) -> float | None:
    """Maximum; None of no values."""
    return float(np.max(values)) if len(values) else None


def rms(values: Sequence[float]) -> float | None:
    """Root mean square; None of no values."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


def rate_bound(events: int, trials: int) -> float:
    """Return the one-sided 95 % upper bound of a binomial rate (Clopper and Pearson 1934).

    >>> round(rate_bound(0, 300), 4)
    0.0099
    """
    from scipy.special import betaincinv

    if events >= trials:
        return 1.0
    return float(betaincinv(events + 1, trials - events, CONFIDENCE))


def count_bound(events: int) -> float:
    """Return the one-sided 95 % upper bound of a Poisson mean (Garwood 1936).

    Divided by the observation time, it bounds the rate.
    """
    from scipy.special import gammaincinv

    return float(gammaincinv(events + 1, CONFIDENCE))


def rate_interval(events: int, trials: int) -> tuple[float, float]:
    """Return the two-sided 95 % interval of a binomial rate (Clopper and Pearson 1934)."""
    from scipy.special import betaincinv

    tail = (1 - CONFIDENCE) / 2
    low = betaincinv(events, trials - events + 1, tail) if events else 0.0
    high = betaincinv(events + 1, trials - events, 1 - tail) if events < trials else 1.0
    return float(low), float(high)


def origin_of(records: Sequence[Record]) -> Row:
    """Return the seeds and grids of records, and the versions of the program that made them."""
    return {
        "seeds": sorted({r["seed"] for r in records}),
        "grids": sorted({r["grid"] for r in records if "grid" in r}),
        "versions": [dict(v) for v in sorted({tuple(r["versions"].items()) for r in records})],
    }


def made_from(document: Row, what: str, *details: str, always: Sequence[str] = ()) -> str:
    """Return one line on the records behind a table.

    Parameters
    ----------
    document : dict
        With a count under ``what``, ``seeds`` and ``versions``.
    what : str
        What was counted, such as ``clips``.
    *details : str
        Told of records, if there are any.
    always : sequence of str, optional
        Told in any case.
    """
    parts, seeds = [f"{what}: {document[what]}"], document["seeds"]
    if seeds:
        parts += [f"seeds {seeds[0]} to {seeds[-1]}", *details]
    parts += always
    if len(document["versions"]) > 1:
        parts.append(f"made by {len(document['versions'])} versions of the program")
    return "; ".join(parts)


def shown(value: float | None, form: str = ".3g", unit: str = "") -> str:
    """Return a number for a cell; a dash for None.

    >>> shown(0.12345), shown(2.0, ".0f", " s"), shown(None)
    ('0.123', '2 s', '–')
    """
    return NONE if value is None else f"{value:{form}}{unit}"


def percent(ratio: float | None, form: str = ".3g") -> str:
    """Return a ratio in per cent for a cell; a dash for None.

    >>> percent(0.5), percent(0.5, ".1f")
    ('50 %', '50.0 %')
    """
    return NONE if ratio is None else f"{100.0 * ratio:{form}} %"


def table_of(title: str, columns: Sequence[Column], rows: Iterable[Row]) -> Table:
    """Return a table with a line for each row.

    Parameters
    ----------
    title : str
    columns : sequence of tuple
        The format of a field may be that of a number and a unit; ``%`` is of a ratio.
    rows : iterable of dict

    Examples
    --------
    >>> table_of("", [("of", "n"), ("share", "r", ".0f %"), ("took", "t", ".1f s")],
    ...          [{"n": 3, "r": 0.5, "t": 2.0}])
    ('', ['of', 'share', 'took'], [['3', '50 %', '2.0 s']])
    """
    return (
        title,
        [column[0] for column in columns],
        [[_cell(row, *c[1:]) for c in columns] for row in rows],
    )


def _cell(row: Row, of: str | Callable[[Row], str], form: str = "") -> str:
    if callable(of):
        return of(row)
    if form in ("", SOME):
        return str(row[of] or "") if form else str(row[of])
    number, space, unit = form.partition(" ")
    return percent(row[of], number) if unit == "%" else shown(row[of], number, space + unit)


def by_method(
    title: str, columns: Sequence[Column], brief: Callable[[Row], str], rows: Iterable[Row]
) -> Table:
    """Return a table with a column for each method, and a line for rows that are else alike.

    Parameters
    ----------
    title : str
    columns : sequence of tuple
        Before those of the methods.
    brief : callable
        From a row to the text in its method's column.
    rows : iterable of dict
    """
    lines: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        line = lines.setdefault(tuple(_cell(row, *c[1:]) for c in columns), {})
        line[row["method"]] = brief(row)
    methods = list(dict.fromkeys(method for line in lines.values() for method in line))
    head = [*(column[0] for column in columns), *methods]
    return (
        title,
        head,
        [[*key, *(line.get(m, NONE) for m in methods)] for key, line in lines.items()],
    )


def written(table: Table, *, on_page: bool) -> str:
    """Return a table without its title, aligned to the right or in Markdown.

    Columns with nothing in any line are left out.
    """
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
    parts = [
        f"{heading.format(table[0])}\n\n{written(table, on_page=on_page)}"
        for table in tables
        if table[2]
    ]
    return "\n\n".join([*parts, *notes])


@contextmanager
def picture(path: Path, size_inch: tuple[float, float]) -> Iterator[Figure]:
    """Give a figure to draw on, and write it as a PNG file, which appears when it is complete.

    Parameters
    ----------
    path : Path
    size_inch : (float, float)
        Width and height, at 110 pixels an inch.

    Raises
    ------
    RecordingError
        When the file can't be written.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size_inch, layout="constrained")
    FigureCanvasAgg(figure)
    yield figure
    with whole_file(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)
