"""A column of times to UTC: ISO 8601 with or without a zone, Unix time, or seconds from a start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.columns import numbers
from rsenf.reference.local_time import settled, to_utc
from rsenf.reference.notes import Notes
from rsenf.timebase import NS_PER_S

if TYPE_CHECKING:
    import pyarrow as pa

ACCEPTED = "ISO 8601 (2022-09-17 00:00:01), Unix time in seconds or milliseconds, or seconds"
HEAD_CELLS = 1000
_ZONED = r"^(?P<local>.*:\d\d(?:[.,]\d+)?)\s*(?P<zone>[zZ]|UTC|GMT|[+-]\d\d:?(?:\d\d)?)$"
# From this size on a number counts so many ns since 1970; smaller ones are seconds from a start.
_UNITS = ((1e17, 1), (1e14, 1_000), (1e11, 1_000_000), (1e8, NS_PER_S))


@dataclass(frozen=True, eq=False)
class Times:
    """Times in ns, and which of them could be read.

    They may be fewer than the cells: the last ones wait for what follows them.
    """

    t_ns: Int64Array
    ok: NDArray[np.bool_]


class TimeReader:
    """Reads a column of times, piece by piece; of which form they are the first piece tells.

    Parameters
    ----------
    where : str
        Name of the file, for error messages.
    timezone : str, optional
        IANA name of the zone of times that don't tell their own; UTC when not given.
    notes : Notes
    """

    def __init__(self, where: str, timezone: str | None, notes: Notes) -> None:
        self._where, self._timezone, self._notes = where, timezone, notes
        self._unit_ns: int | None = None
        self._form = ""
        self._any = False
        self.absolute = True
        """Whether times are since 1970, rather than since an unknown start."""

    def read(self, cells: pa.Array, *, more: bool = False) -> Times:
        """Read the next cells; with ``more`` to come, as many as they can't change any more.

        Raises
        ------
        ReferenceFormatError
            When hardly any of the first piece is a time.
        """
        if not self._form:
            self._form = _form_of(cells)
            if self._form == "numbers":
                self._find_unit(numbers(cells))
        if self._form == "numbers":
            return self._from_numbers(numbers(cells))
        if self._form == "stamps":
            local_ns, offset_s = _from_stamps(cells)
        else:
            local_ns, offset_s = _from_text(cells)
        return self._from_local(local_ns, offset_s, cells, more)

    def _find_unit(self, values: FloatArray) -> None:
        typical = float(np.nanmedian(np.abs(values)))
        self._unit_ns = next((ns for least, ns in _UNITS if typical >= least), None)
        self.absolute = self._unit_ns is not None
        if self._timezone:
            self._notes.say("--timezone has no bearing on times given as numbers")

    def _from_numbers(self, values: FloatArray) -> Times:
        ok = np.isfinite(values)
        # Whole and fractional units apart: a double holds Unix nanoseconds to a quarter of a µs.
        whole = np.floor(np.where(ok, values, 0.0))
        scale = self._unit_ns or NS_PER_S
        part = np.rint((np.where(ok, values, 0.0) - whole) * scale)
        return Times(whole.astype(np.int64) * scale + part.astype(np.int64), ok)

    def _from_local(
        self, local: NDArray[np.datetime64], offset_s: FloatArray, cells: pa.Array, more: bool
    ) -> Times:
        ok = ~np.isnat(local)
        self._any = self._any or bool(ok.any())
        if not self._any:
            raise ReferenceFormatError(
                f"{self._where}: {cells[0].as_py()!r} in the time column is no time",
                f"expected {ACCEPTED}",
            )
        t_ns = np.where(ok, local.astype(np.int64), 0)
        naive = np.isnan(offset_s) & ok
        t_ns -= np.where(np.isnan(offset_s), 0.0, offset_s).astype(np.int64) * NS_PER_S
        if not naive.any():
            return Times(t_ns, ok)
        self._notes.say(f"times without a zone taken as {self._timezone or 'UTC'}")
        if self._timezone is None:
            return Times(t_ns, ok)
        rows = np.flatnonzero(naive)
        done = settled(t_ns[rows], self._timezone) if more else rows.size
        end = t_ns.size if done == rows.size else rows[done]
        t_ns[rows[:done]], ok[rows[:done]] = to_utc(t_ns[rows[:done]], self._timezone, self._notes)
        return Times(t_ns[:end], ok[:end])


def _form_of(cells: pa.Array) -> str:
    import pyarrow as pa

    if pa.types.is_timestamp(cells.type) or pa.types.is_date(cells.type):
        return "stamps"
    return "numbers" if np.isfinite(numbers(cells[:HEAD_CELLS])).mean() > 0.5 else "text"


def _from_stamps(cells: pa.Array) -> tuple[NDArray[np.datetime64], FloatArray]:
    """Return Arrow's time stamps; those with a zone are UTC already, an offset of 0."""
    import pyarrow as pa

    zoned = getattr(cells.type, "tz", None) is not None
    local = cells.cast(pa.timestamp("ns")).to_numpy(zero_copy_only=False)
    return local, np.full(len(cells), 0.0 if zoned else np.nan)


def _from_text(cells: pa.Array) -> tuple[NDArray[np.datetime64], FloatArray]:
    """Return local times, and their zones as seconds east; NaN for none."""
    import pyarrow as pa
    import pyarrow.compute as pc

    offset_s = np.full(len(cells), np.nan)
    if pc.any(pc.match_substring_regex(cells, _ZONED)).as_py():
        parts = pc.extract_regex(cells, _ZONED)
        zones = pc.struct_field(parts, "zone").dictionary_encode()
        east = np.array([_seconds_east(zone) for zone in zones.dictionary.to_pylist()] + [np.nan])
        offset_s = east[zones.indices.fill_null(-1).to_numpy(zero_copy_only=False)]
        cells = pc.coalesce(pc.struct_field(parts, "local"), cells)
    try:
        local = cells.cast(pa.timestamp("ns"))
    except pa.ArrowInvalid:
        return _parse(cells), offset_s
    return local.to_numpy(zero_copy_only=False), offset_s


def _seconds_east(zone: str) -> int:
    """Return the offset of Z, UTC, GMT, ±hh, ±hhmm or ±hh:mm."""
    if zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "")
    east = int(digits[:2]) * 3600 + int(digits[2:] or 0) * 60
    return -east if zone[0] == "-" else east


def _parse(cells: pa.Array) -> NDArray[np.datetime64]:
    plain = [c.replace("/", "-").replace(",", ".").strip() for c in cells.to_pylist()]
    try:
        return np.array(plain, "datetime64[ns]")
    except ValueError:
        return np.array([_parse_one(cell) for cell in plain], "datetime64[ns]")


def _parse_one(cell: str) -> np.datetime64:
    try:
        return np.datetime64(cell, "ns")
    except ValueError:
        return np.datetime64("NaT", "ns")
