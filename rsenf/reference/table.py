"""Reads columns of text (separators, decimal commas, headers, meaning), and of Parquet files."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.reference.columns import ACCEPTED, Columns, find_columns, number
from rsenf.reference.reference import Notes
from rsenf.reference.times import looks_written

if TYPE_CHECKING:
    import pyarrow as pa

BLOCK_CHARS = 1 << 22  # some hundred thousand lines
HEAD_ROWS = 100
_PEEK = 4096
_TIME_OF_DAY = re.compile(r"\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?(\s?[AaPp][Mm])?")
_DATE = re.compile(r"\d{1,4}([./-])\d{1,2}\1\d{1,4}")
_SEPARATOR = re.compile(r'"?sep=(.)"?', re.IGNORECASE)  # a first line for spreadsheets
LEAST_UNIX = 1e8  # smallest number that is taken as a time since 1970
BATCH_ROWS = 1 << 18


def text_blocks(path: Path) -> Iterator[str]:
    """Yield a file's text in blocks of whole lines.

    Parameters
    ----------
    path : Path
        Plain or gzipped; UTF-8, or UTF-16 with a byte-order mark.

    Raises
    ------
    ReferenceFormatError
        If it is no text, or a damaged gzip file.
    """
    with path.open("rb") as file:
        raw: Any = gzip.GzipFile(fileobj=file) if file.peek(2)[:2] == b"\x1f\x8b" else file
        try:
            encoding = encoding_of(raw.peek(_PEEK), path.name)
            text = io.TextIOWrapper(raw, encoding, errors="replace")
            while block := text.read(BLOCK_CHARS):
                yield block + text.readline()
        except (gzip.BadGzipFile, EOFError, zlib.error):
            raise ReferenceFormatError(
                f"{path.name} is a damaged gzip file", "fetch or copy it again"
            ) from None


def encoding_of(head: bytes, name: str) -> str:
    """Return the encoding of a text file by its first bytes: UTF-8 or UTF-16.

    Raises
    ------
    ReferenceFormatError
        If it is no text.
    """
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    if b"\0" in head:
        raise ReferenceFormatError(
            f"{name} is no text file", "give a CSV, Parquet, WAV or NPZ file"
        )
    return "utf-8-sig"


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
        columns = _split(text, layout, where)
        rows += len(columns.frequency)
        if len(columns.frequency):
            yield columns
    if layout is None:
        raise ReferenceFormatError(f"{where} is empty", f"expected {ACCEPTED}")
    if not rows:
        raise ReferenceFormatError(f"{where} has a header but no values")


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def _rows(lines: list[str], separator: str, where: str) -> list[list[str]]:
    try:
        return list(csv.reader(lines, delimiter=separator, skipinitialspace=True))
    except csv.Error as exc:  # a cell is too long
        raise ReferenceFormatError(f"{where}: {exc}", "look for a quote that isn't closed") from exc


def _layout(
    lines: list[str], where: str, column: str | None, time_column: str | None, notes: Notes
) -> tuple[Layout, int]:
    """Return the positions of the cells, and the number of lines before the values."""
    declared = _SEPARATOR.fullmatch(lines[0].rstrip())
    above = 1 if declared else 0
    lines = lines[above:]
    if not lines:
        raise ReferenceFormatError(f"{where} has no values")
    # ; or tab if all of the first rows have it, as commas may be decimal.
    found = (s for s in ";\t" if all(s in line for line in lines[:3]))
    separator = declared[1] if declared else next(found, ",")
    rows = _rows(lines[: HEAD_ROWS + 1], separator, where)
    # Names begin with a letter and aren't numbers.
    if any(c[:1].isalpha() and np.isnan(number(c)) for c in map(str.strip, rows[0])):
        return _with_header(rows, separator, where, column, time_column), above + 1
    if asked := column or time_column:
        raise ReferenceFormatError(f"{where} has no header, so no column {asked!r}")
    return _without_header(rows[:HEAD_ROWS], separator, where, notes), above


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
        time = _first_that(lambda c: looks_written(c) or number(c) >= LEAST_UNIX, others)
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


def _split(text: str, layout: Layout, where: str) -> Columns:
    import pyarrow.compute as pc

    wanted = [i for i in (layout.frequency, layout.time, layout.date) if i is not None]
    cells = _split_plain(text, layout, wanted) or _split_any(text, layout, wanted, where)
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


def _split_any(text: str, layout: Layout, wanted: list[int], where: str) -> dict[int, pa.Array]:
    import pyarrow as pa

    rows = _rows(_lines(text), layout.separator, where)
    return {
        i: pa.array([row[i] if len(row) > i else "" for row in rows], pa.string()) for i in wanted
    }


def parquet_columns(
    path: Path, column: str | None, time_column: str | None = None
) -> Iterator[Columns]:
    """Yield the frequency and the time column, some rows at a time.

    A time column is found by its name, or as the only column of Arrow time stamps.

    Raises
    ------
    ReferenceFormatError
        If it is no Parquet file, or there is no such column.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with parquet.ParquetFile(path) as file:
            fields = list(file.schema_arrow)
            frequency, time = _find(fields, path.name, column, time_column)
            wanted = [f.name for f in (frequency, time) if f is not None]
            for batch in file.iter_batches(BATCH_ROWS, columns=wanted, use_threads=False):
                batch.validate(full=True)
                if batch.num_rows:
                    times = None if time is None else _decoded(batch.column(time.name))
                    values = _decoded(batch.column(frequency.name))
                    yield Columns(values, times, frequency.name, getattr(time, "name", ""))
    except (pa.ArrowException, OSError, UnicodeDecodeError) as exc:
        reason = str(exc).splitlines()[0].rstrip(". ")
        raise ReferenceFormatError(
            f"{path.name} is no Parquet file that can be read: {reason}", "fetch or copy it again"
        ) from None


def _find(
    fields: list[pa.Field], where: str, column: str | None, time_column: str | None
) -> tuple[pa.Field, pa.Field | None]:
    import pyarrow as pa

    frequency, time, _ = find_columns([f.name for f in fields], where, column, time_column)
    is_a = pa.types
    tests = is_a.is_floating, is_a.is_integer, is_a.is_decimal, is_a.is_string, is_a.is_large_string
    for at, more, wanted, option in (
        (frequency, (), "numbers", "--column"),
        (time, (is_a.is_timestamp, is_a.is_date), "times", "--time-column"),
    ):
        kind = None if at is None else _decoded(pa.nulls(0, fields[at].type)).type
        if at is not None and not any(test(kind) for test in (*tests, *more)):
            raise ReferenceFormatError(
                f"{where}: column {fields[at].name!r} holds {fields[at].type}, no {wanted}",
                f"is it the right column? See {option}",
            )
    if time is not None:
        return fields[frequency], fields[time]
    stamps = [f for f in fields if is_a.is_timestamp(f.type)]
    return fields[frequency], stamps[0] if len(stamps) == 1 else None


def _decoded(cells: pa.Array) -> pa.Array:
    """Return cells without a dictionary, and text that is declared as bytes as text."""
    import pyarrow as pa

    cells = cells.dictionary_decode() if pa.types.is_dictionary(cells.type) else cells
    is_bytes = pa.types.is_binary(cells.type) or pa.types.is_large_binary(cells.type)
    return cells.cast(pa.string()) if is_bytes else cells
