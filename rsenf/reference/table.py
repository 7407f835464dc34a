"""Splits text into columns: separators, decimal commas, headers, and the columns' meaning."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.reference.columns import ACCEPTED, Columns, find_columns, number
from rsenf.reference.notes import Notes
from rsenf.reference.written_times import looks_written

if TYPE_CHECKING:
    import pyarrow as pa

HEAD_ROWS = 100
_TIME_OF_DAY = re.compile(r"\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?(\s?[AaPp][Mm])?")
_DATE = re.compile(r"\d{1,4}([./-])\d{1,2}\1\d{1,4}")
_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)  # a first line for spreadsheets
LEAST_UNIX = 1e8  # smallest number that is taken as a time since 1970


@dataclass(frozen=True)
class Layout:
    """Positions of the cells in a line; ``date`` is joined with ``time`` if that has no date."""

    separator: str
    width: int
    frequency: int
    time: int | None = None
    date: int | None = None
    frequency_name: str = ""
    time_name: str = ""


def table_columns(
    blocks: Iterable[str],
    where: str,
    column: str | None,
    notes: Notes,
    time_column: str | None = None,
) -> Iterator[Columns]:
    """Yield the columns of a text file, block by block.

    Parameters
    ----------
    blocks : iterable of str
        The file's text, in whole lines.
    where : str
        Its name, for error messages.
    column : str, optional
        Name of the frequency column; one of the usual names if None.
    notes : Notes
    time_column : str, optional
        Name of the time column; found by its name, then by its content, if None.

    Raises
    ------
    ReferenceFormatError
        If there is nothing in it, or no such column.
    """
    layout = None
    rows = 0
    for text in blocks:
        if layout is None:
            if not (lines := _lines(text)):
                continue
            layout, skip = _layout(lines, where, column, time_column, notes)
            text = "\n".join(lines[skip:])
        columns = _split(text, layout)
        rows += len(columns.frequency)
        if len(columns.frequency):
            yield columns
    if layout is None:
        raise ReferenceFormatError(f"{where} is empty", f"expected {ACCEPTED}")
    if not rows:
        raise ReferenceFormatError(f"{where} has a header but no values")


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def _rows(lines: list[str], separator: str) -> list[list[str]]:
    return list(csv.reader(lines, delimiter=separator, skipinitialspace=True))


def _layout(
    lines: list[str], where: str, column: str | None, time_column: str | None, notes: Notes
) -> tuple[Layout, int]:
    """Return the positions of the cells, and the number of lines before the values."""
    declared = _SEPARATOR.fullmatch(lines[0].rstrip())
    above = 1 if declared else 0
    lines = lines[above:]
    if not lines:
        raise ReferenceFormatError(f"{where} has no values")
    separator = declared[1] if declared else _separator(lines)
    rows = _rows(lines[: HEAD_ROWS + 1], separator)
    if _is_header(rows[0]):
        return _with_header(rows, separator, where, column, time_column), above + 1
    if asked := column or time_column:
        raise ReferenceFormatError(f"{where} has no header, so no column {asked!r}")
    return _without_header(rows[:HEAD_ROWS], separator, where, notes), above


def _separator(lines: list[str]) -> str:
    """Return the separator of the first rows: ; or tab if all have it, as commas may be decimal."""
    head = lines[:3]
    return next((s for s in ";\t" if all(s in line for line in head)), ",")


def _is_header(row: list[str]) -> bool:
    """Whether a first row holds names: cells that begin with a letter and aren't numbers."""
    return any(c[:1].isalpha() and np.isnan(number(c)) for c in (cell.strip() for cell in row))


def _with_header(
    rows: list[list[str]], separator: str, where: str, column: str | None, time_column: str | None
) -> Layout:
    header, body = rows[0], rows[1:]
    frequency, time, date = find_columns(header, where, column, time_column)
    if body and len(body[0]) > len(header):
        raise ReferenceFormatError(
            f"{where}: {len(header)} columns in the header, {len(body[0])} in the first row",
            "a decimal comma needs ; or tab between the columns",
        )
    first = [cell.strip() for cell in body[0]] if body else []
    others = {i: cell for i, cell in enumerate(first) if i != frequency}
    if time is None:
        time = _first_that(_is_time, others)
    if time is None:
        time = _first_that(_TIME_OF_DAY.fullmatch, others)
    if time is None or not _TIME_OF_DAY.fullmatch(others.get(time, "")):
        date = None
    elif date is None:
        date = _first_that(_DATE.fullmatch, others)
    time_name = "" if time is None else header[time]
    return Layout(separator, len(header), frequency, time, date, header[frequency], time_name)


def _first_that(test: Callable[[str], Any], cells: dict[int, str]) -> int | None:
    return next((i for i, cell in cells.items() if test(cell)), None)


def _is_time(cell: str) -> bool:
    return looks_written(cell) or number(cell) >= LEAST_UNIX


def _without_header(rows: list[list[str]], separator: str, where: str, notes: Notes) -> Layout:
    """Layout of a single column of values, or of a column of times and one of values."""
    widths = {len(row) for row in rows}
    if widths == {1}:
        return Layout(separator, 1, 0)
    times = np.array([number(row[0]) for row in rows])
    rising = bool(np.all(np.diff(times) > 0)) if np.isfinite(times).all() else np.isnan(times).all()
    if widths != {2} or not rising:
        raise ReferenceFormatError(
            f"{where} has no header and {max(widths)} columns", f"expected {ACCEPTED}"
        )
    notes.say("no header: took the first column for times, the second for frequencies")
    return Layout(separator, 2, 1, 0)


def _split(text: str, layout: Layout) -> Columns:
    import pyarrow.compute as pc

    wanted = [i for i in (layout.frequency, layout.time, layout.date) if i is not None]
    cells = _split_plain(text, layout, wanted) or _split_any(text, layout, wanted)
    cells = {i: pc.utf8_trim_whitespace(cells[i]) for i in wanted}
    time = None if layout.time is None else cells[layout.time]
    if layout.date is not None:
        time = pc.binary_join_element_wise(cells[layout.date], time, " ")
    return Columns(cells[layout.frequency], time, layout.frequency_name, layout.time_name)


def _split_plain(text: str, layout: Layout, wanted: list[int]) -> dict[int, pa.Array] | None:
    """Split lines without quotes and comments, ten times as fast; None for others."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    if layout.width == 1 or '"' in text or "#" in text or not text:
        return None
    pa.enable_signal_handlers(False)  # or it would raise an error on a node's stop signal
    names = [str(i) for i in range(layout.width)]
    data = text.encode()
    try:
        table = arrow_csv.read_csv(
            pa.BufferReader(data),
            arrow_csv.ReadOptions(use_threads=False, block_size=len(data) + 1, column_names=names),
            arrow_csv.ParseOptions(delimiter=layout.separator, quote_char=False),
            arrow_csv.ConvertOptions(
                include_columns=[names[i] for i in wanted],
                column_types={name: pa.string() for name in names},
                strings_can_be_null=False,
            ),
        )
    except pa.ArrowInvalid:
        return None
    return {i: table[names[i]].combine_chunks() for i in wanted}


def _split_any(text: str, layout: Layout, wanted: list[int]) -> dict[int, pa.Array]:
    import pyarrow as pa

    rows = _rows(_lines(text), layout.separator)
    return {
        i: pa.array([row[i] if len(row) > i else "" for row in rows], pa.string()) for i in wanted
    }
