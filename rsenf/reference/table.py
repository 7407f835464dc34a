"""Text to columns: separators, decimal commas, headers, and which column is which."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray

FREQUENCY_NAMES = (
    "frequency",
    "hz",
    "f",
    "freq",
    "frequency_hz",
    "freq_hz",
    "f_hz",
    "enf",
    "enf_hz",
    "value",
)
TIME_NAMES = (
    "timestamp",
    "datetime",
    "date_time",
    "time",
    "utc",
    "time_utc",
    "utc_time",
    "date",
    "t",
    "t_s",
    "time_s",
    "seconds",
    "unix",
    "epoch",
)
ACCEPTED = (
    "a column named frequency, Hz or f (see --column), a time column, separated by , ; or tab; "
    "or values alone with --step-s"
)
_UNIT = re.compile(r"\s*[\[(].*?[\])]\s*")
_TIME_OF_DAY = re.compile(r"\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?")


@dataclass(frozen=True, eq=False)
class Table:
    """Cells of the frequency column, and of the time column where there is one."""

    frequency: list[str]
    time: list[str] | None
    notes: list[str]


def read_table(text: str, where: str, column: str | None) -> Table:
    """Find the frequency and the time column of a text file.

    Parameters
    ----------
    text : str
        The whole file.
    where : str
        Its name, for error messages.
    column : str, optional
        Name of the frequency column; looked for among the usual names when not given.

    Raises
    ------
    ReferenceFormatError
        When there is nothing in it, or no such column.
    """
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise ReferenceFormatError(f"{where} is empty", f"expected {ACCEPTED}")
    separator = _separator(lines)
    rows = list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
    if _is_header(rows[0]):
        return _with_header(rows, where, column)
    if column is not None:
        raise ReferenceFormatError(f"{where} has no header, so no column {column!r}")
    return _without_header(rows, where)


def numbers(cells: Sequence[str]) -> FloatArray:
    """Parse numbers, with a decimal point or comma; NaN for what isn't one."""
    try:
        return np.array(cells, np.float64)
    except ValueError:
        return np.array([_number(cell) for cell in cells])


def _number(cell: str) -> float:
    try:
        return float(cell.replace(",", "."))
    except ValueError:
        return float("nan")


def _separator(lines: list[str]) -> str:
    """Return the separator of the first rows: a decimal comma never beats ; or tab."""
    head = lines[:3]
    return next((s for s in ";\t" if all(s in line for line in head)), ",")


def _is_header(row: list[str]) -> bool:
    """Whether a first row holds names: it has a letter where no number or time has one."""
    return any(c[:1].isalpha() and np.isnan(_number(c)) for c in (cell.strip() for cell in row))


def _with_header(rows: list[list[str]], where: str, column: str | None) -> Table:
    names = [_UNIT.sub("", name.strip().lower()).replace(" ", "_") for name in rows[0]]
    found = ", ".join(name.strip() for name in rows[0])
    wanted = FREQUENCY_NAMES if column is None else (_UNIT.sub("", column.strip().lower()),)
    frequency = _first_of(wanted, names)
    if frequency is None:
        asked = "no frequency column" if column is None else f"no column {column!r}"
        raise ReferenceFormatError(
            f"{asked} in {where}; its columns are: {found}", f"expected {ACCEPTED}"
        )
    body = rows[1:]
    if not body:
        raise ReferenceFormatError(f"{where} has a header but no values")
    if len(body[0]) > len(names):
        raise ReferenceFormatError(
            f"{where}: {len(names)} columns in the header, {len(body[0])} in the first row",
            "a decimal comma needs ; or tab between the columns",
        )
    others = [name if i != frequency else "" for i, name in enumerate(names)]
    time = _first_of(TIME_NAMES, others)
    cells = None if time is None else _cells(body, time)
    date = _first_of(("date",), others)
    if cells and date is not None and date != time and _TIME_OF_DAY.fullmatch(cells[0]):
        cells = [f"{d} {t}" for d, t in zip(_cells(body, date), cells, strict=True)]
    return Table(_cells(body, frequency), cells, [])


def _without_header(rows: list[list[str]], where: str) -> Table:
    """One column of values; or a column of times and one of values."""
    widths = {len(row) for row in rows[:100]}
    if widths == {1}:
        return Table(_cells(rows, 0), None, [])
    times = numbers(_cells(rows[:100], 0))
    rising = bool(np.all(np.diff(times) > 0)) if np.isfinite(times).all() else np.isnan(times).all()
    if widths != {2} or not rising:
        raise ReferenceFormatError(
            f"{where} has no header and {max(widths)} columns", f"expected {ACCEPTED}"
        )
    note = "no header: took the first column for times, the second for frequencies"
    return Table(_cells(rows, 1), _cells(rows, 0), [note])


def _first_of(wanted: Sequence[str], names: list[str]) -> int | None:
    return next((names.index(name) for name in wanted if name in names), None)


def _cells(rows: list[list[str]], column: int) -> list[str]:
    return [row[column].strip() if len(row) > column else "" for row in rows]
