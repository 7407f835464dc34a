"""Finds the frequency and time columns by name, and converts cells to numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray

if TYPE_CHECKING:
    import pyarrow as pa

FREQUENCY_NAMES = (
    "frequency", "hz", "f", "freq", "frequency_hz", "freq_hz", "f_hz", "enf", "enf_hz", "value",
    "frequenz", "netzfrequenz", "fréquence", "frecuencia", "frequenza",
)  # fmt: skip
DEVIATION_NAMES = (
    "deviation", "frequency_deviation", "freq_deviation", "delta_f", "delta", "δf", "∆f", "df",
    "f-50", "f-60", "mhz",
)  # fmt: skip
TIME_NAMES = (
    "timestamp", "datetime", "date_time", "time", "utc", "time_utc", "utc_time", "date", "t",
    "t_s", "time_s", "seconds", "unix", "epoch",
)  # fmt: skip
ACCEPTED = (
    "a column named frequency, Hz or f (see --column), a time column, separated by , ; or tab; "
    "or values alone with --step-s"
)
_UNIT = re.compile(r"\s*[\[(].*?[\])]\s*")


@dataclass(frozen=True, eq=False)
class Columns:
    """Consecutive cells of the frequency column, and of the time column if there is one.

    Both are Arrow arrays of the same length: text, numbers or, for times, Arrow time stamps. The
    columns' names may give the unit of the frequency and the zone of the times.
    """

    frequency: pa.Array
    time: pa.Array | None
    frequency_name: str = ""
    time_name: str = ""

    def __add__(self, other: Columns) -> Columns:
        """Join two parts of one file."""
        import pyarrow as pa

        return replace(
            self,
            frequency=pa.concat_arrays([self.frequency, other.frequency]),
            time=None if self.time is None else pa.concat_arrays([self.time, other.time]),
        )

    def split(self, rows: int) -> tuple[Columns, Columns]:
        """Return the first ``rows`` rows, and the others."""
        first = replace(self, frequency=self.frequency[:rows], time=self.time and self.time[:rows])
        rest = replace(self, frequency=self.frequency[rows:], time=self.time and self.time[rows:])
        return first, rest


def find_columns(
    header: Sequence[str], where: str, column: str | None, time_column: str | None = None
) -> tuple[int, int | None, int | None]:
    """Find by name the columns of the frequency, the time, and a separate date.

    Parameters
    ----------
    header : sequence of str
    where : str
    column : str, optional
        Name of the frequency column; one of the usual names if None.
    time_column : str, optional
        Name of the time column, likewise.

    Raises
    ------
    ReferenceFormatError
        If there is no frequency column, or no column of a given name.
    """
    names = [_plain(name) for name in header]

    def missing(what: str) -> ReferenceFormatError:
        found = ", ".join(name.strip() for name in header)
        return ReferenceFormatError(
            f"{what} in {where}; its columns are: {found}", f"expected {ACCEPTED}"
        )

    for asked in (column, time_column):
        if asked is not None and _plain(asked) not in names:
            raise missing(f"no column {asked!r}")
    usual = (*FREQUENCY_NAMES, *DEVIATION_NAMES) if column is None else (_plain(column),)
    bare = [re.sub(r"_?m?hz$", "", name) for name in names]
    frequency = _first_of(usual, names)
    frequency = _first_of(usual, bare) if frequency is None else frequency
    if frequency is None:
        raise missing("no frequency column")
    others = [name if i != frequency else "" for i, name in enumerate(names)]
    wanted = TIME_NAMES if time_column is None else (_plain(time_column),)
    time, date = _first_of(wanted, others), _first_of(("date",), others)
    return frequency, time, date if date != time else None


def says_utc(name: str) -> bool:
    """Whether a time column's name says UTC.

    Examples
    --------
    >>> says_utc("time (UTC)"), says_utc("UTC+1")
    (True, False)
    """
    return bool(re.search(r"(?<![a-z])(utc|gmt)(?![a-z+-])", name.lower()))


def unit_said(name: str) -> str:
    """Return the unit in a frequency column's name: 'mHz', 'Hz' or ''.

    Examples
    --------
    >>> unit_said("deviation [mHz]")
    'mHz'
    """
    found = re.search(r"(?<![a-z])(m?)hz(?![a-z])", name.lower())
    return "" if found is None else f"{found[1]}Hz"


def numbers(cells: pa.Array) -> FloatArray:
    """Convert cells to numbers, with a decimal point or comma; NaN for anything else."""
    import pyarrow as pa

    if pa.types.is_decimal(cells.type):
        cells = cells.cast(pa.string())  # parsed as printed, so that nothing is rounded twice
    try:
        values = cells.cast(pa.float64(), safe=False)
    except pa.ArrowInvalid:
        return np.array([number(cell) for cell in cells.to_pylist()], np.float64)
    return np.asarray(values.to_numpy(zero_copy_only=False), np.float64)


def number(cell: str | None) -> float:
    """Convert one cell to a number; NaN if it isn't one."""
    try:
        return float((cell or "").replace(",", "."))
    except ValueError:
        return float("nan")


def _plain(name: str) -> str:
    return _UNIT.sub("", name.strip().lower()).replace(" ", "_")


def _first_of(wanted: Sequence[str], names: list[str]) -> int | None:
    return next((names.index(name) for name in wanted if name in names), None)
