"""A column of times to UTC: ISO 8601 with or without a zone, Unix time, or seconds from a start."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.local_time import to_utc
from rsenf.reference.table import numbers
from rsenf.timebase import NS_PER_S

ACCEPTED = "ISO 8601 (2022-09-17 00:00:01), Unix time in seconds or milliseconds, or seconds"
_ZONE = re.compile(
    r":\d\d(?:[.,]\d+)?\s*"
    r"(?P<zone>[zZ]|UTC|GMT|(?P<sign>[+-])(?P<hours>\d\d):?(?P<minutes>\d\d)?)$"
)
# From this size on a number counts so many ns since 1970; smaller ones are seconds from a start.
_UNITS = ((1e17, 1), (1e14, 1_000), (1e11, 1_000_000), (1e8, NS_PER_S))


@dataclass(frozen=True, eq=False)
class Times:
    """Times in ns, and which of them could be read.

    ``absolute`` tells UTC since 1970 from seconds since an unknown start.
    """

    t_ns: Int64Array
    ok: NDArray[np.bool_]
    absolute: bool
    notes: list[str]


def read_times(cells: list[str], where: str, timezone: str | None) -> Times:
    """Parse a column of times.

    Parameters
    ----------
    cells : list of str
    where : str
        Name of the file, for error messages.
    timezone : str, optional
        IANA name of the zone of times that don't tell their own; UTC when not given.

    Raises
    ------
    ReferenceFormatError
        When hardly any of them is a time.
    """
    values = numbers(cells)
    if np.isfinite(values).mean() > 0.5:
        return _from_numbers(values, timezone)
    return _from_iso(cells, where, timezone)


def _from_numbers(values: FloatArray, timezone: str | None) -> Times:
    ok = np.isfinite(values)
    typical = float(np.median(np.abs(values[ok])))
    unit_ns = next((ns for least, ns in _UNITS if typical >= least), None)
    notes = ["--timezone has no bearing on times given as numbers"] if timezone else []
    # Whole and fractional units apart: a double holds Unix nanoseconds to a quarter of a µs only.
    whole = np.floor(np.where(ok, values, 0.0))
    scale = unit_ns or NS_PER_S
    part = np.rint((np.where(ok, values, 0.0) - whole) * scale)
    t_ns = whole.astype(np.int64) * scale + part.astype(np.int64)
    return Times(t_ns, ok, unit_ns is not None, notes)


def _from_iso(cells: list[str], where: str, timezone: str | None) -> Times:
    plain, offset_s = _split_zones(cells)
    local = _parse(plain)
    ok = ~np.isnat(local)
    if not ok.any():
        raise ReferenceFormatError(
            f"{where}: {cells[0]!r} in the time column is no time", f"expected {ACCEPTED}"
        )
    t_ns = np.where(ok, local.astype(np.int64), 0)
    naive = np.isnan(offset_s) & ok
    t_ns -= np.where(np.isnan(offset_s), 0.0, offset_s).astype(np.int64) * NS_PER_S
    notes: list[str] = []
    if naive.any() and timezone is None:
        notes.append("times without a zone taken as UTC")
    elif naive.any():
        notes.append(f"times without a zone taken as {timezone}")
        t_ns[naive], ok[naive], more = to_utc(t_ns[naive], str(timezone))
        notes += more
    return Times(t_ns, ok, True, notes)


def _split_zones(cells: list[str]) -> tuple[list[str], FloatArray]:
    """Return the times without their zones, and the zones as seconds east; NaN for none."""
    plain, offset_s = [], np.full(len(cells), np.nan)
    for i, cell in enumerate(cells):
        zone = _ZONE.search(cell)
        if zone:
            sign, hours, minutes = zone["sign"], zone["hours"], zone["minutes"]
            east = int(hours or 0) * 3600 + int(minutes or 0) * 60
            offset_s[i] = -east if sign == "-" else east
            cell = cell[: zone.start("zone")]
        plain.append(cell.replace("/", "-").replace(",", ".").strip())
    return plain, offset_s


def _parse(plain: list[str]) -> NDArray[np.datetime64]:
    try:
        return np.array(plain, "datetime64[ns]")
    except ValueError:
        return np.array([_parse_one(cell) for cell in plain], "datetime64[ns]")


def _parse_one(cell: str) -> np.datetime64:
    try:
        return np.datetime64(cell, "ns")
    except ValueError:
        return np.datetime64("NaT", "ns")
