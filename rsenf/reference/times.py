"""Converts a column of times to UTC: text with or without a zone, Unix time, or seconds.

Text is read as loggers and spreadsheets write it; its format, and the order of day and month, are
found from the cells unless a format is given.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.messages.schema import FloatArray, Int64Array
from rsenf.reference.columns import numbers
from rsenf.reference.local_time import find_jump, settled, to_utc
from rsenf.reference.reference import Notes
from rsenf.timebase import NO_ZONE, NS_PER_S

if TYPE_CHECKING:
    import pyarrow as pa

ACCEPTED = "ISO 8601 (2022-09-17 00:00:01), Unix time in seconds or milliseconds, or seconds"
HEAD_CELLS = 1000
_WRITTEN = re.compile(
    r"(?P<date>\d{1,4}(?P<mark>[./-])\d{1,2}(?P=mark)\d{1,4})(?P<between>[ T]|, )"
    r"\d{1,2}:\d\d(?P<seconds>:\d\d)?(?:[.,]\d+)?(?P<half>\s?[AaPp][Mm])?"
)
ZONE = r"[zZ]|UTC|GMT|[+-]\d\d:?(?:\d\d)?"
_FRACTION = r"(?P<whole>:\d\d)[.,](?P<fraction>\d{1,9})"
_ISO = "%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%S"
DAY = np.timedelta64(1, "D")
MOST_S = 9.2e9  # before and after 1970, that ns in 64 bits can tell
ENDS_NS = 2 * 3600 * NS_PER_S  # end of a piece kept for the next: it may split a repeated hour
_ZONED = rf"^(?P<local>.*:\d\d(?:[.,]\d+)?(?:\s?[AaPp][Mm])?)\s*(?P<zone>{ZONE})$"
# Units of Unix times (ns), by their least size; smaller numbers are seconds from a start.
_UNITS = ((1e17, 1), (1e14, 1_000), (1e11, 1_000_000), (1e8, NS_PER_S))


def checked_format(text: str) -> None:
    """Refuse a format of times that doesn't determine the day.

    Raises
    ------
    UsageError
    """
    moment = datetime(2026, 1, 15, 8)
    try:
        parsed = datetime.strptime(moment.strftime(_plain(text)), _plain(text))
    except ValueError:
        parsed = None
    if parsed is None or parsed.date() != moment.date():
        raise UsageError(f"no format of times {text!r}", "e.g. '%d.%m.%Y %H:%M:%S'")


def looks_written(cell: str) -> bool:
    """Whether a cell is a date with a time of day, in any order, with or without a zone."""
    return bool(re.fullmatch(rf"(?:{_WRITTEN.pattern})(?:\s*(?:{ZONE}))?", cell))


class WrittenTimes:
    """Reads a column of text, piece by piece, by the format that the first conclusive piece has.

    Parameters
    ----------
    where : str
    time_format : str, optional
        Of ``strptime``; found from the cells if None.
    notes : Notes
    """

    def __init__(self, where: str, time_format: str | None, notes: Notes) -> None:
        self._where, self._notes = where, notes
        self._formats = [_plain(time_format)] if time_format else []
        self._example = ""
        self.known = bool(time_format)
        """Whether the format is, or that it is none of these."""

    def knows_format(self, cells: pa.Array) -> bool:
        """Whether these or earlier cells fix the format; False if day and month may be swapped."""
        if not self.known:
            self._formats, self._example = _formats_of(cells)
            self.known = len(self._formats) < 2
            if self._formats and self.known and self._formats[0] not in _ISO:
                self._notes.say(f"times read as {self._formats[0]}")
        return self.known

    @property
    def ambiguity(self) -> ReferenceFormatError:
        """The error to raise if day and month can't be distinguished."""
        either = " or ".join(f"'{text}'" for text in self._formats)
        return ReferenceFormatError(
            f"{self._where}: {self._example!r} may be day or month first: give --time-format "
            f"{either}"
        )

    def read(self, cells: pa.Array) -> NDArray[np.datetime64]:
        """Read cells; NaT for those that are no such time."""
        import pyarrow as pa

        if not self._formats or self._formats[0] in _ISO:  # Arrow's own parser is the fastest
            try:
                return _instants(cells)
            except pa.ArrowInvalid:
                pass
        if not self._formats:
            return np.full(len(cells), "NaT", "datetime64[ns]")
        return _read(cells, self._formats[0])


def _instants(cells: pa.Array) -> NDArray[np.datetime64]:
    """Convert to NumPy, nulls to NaT. Arrow's own conversion of times imports pandas."""
    import pyarrow as pa

    counts = cells.cast(pa.timestamp("ns")).cast(pa.int64()).fill_null(np.iinfo(np.int64).min)
    return np.asarray(counts.to_numpy(zero_copy_only=False)).view("datetime64[ns]")


def _plain(text: str) -> str:
    """Return a format without fractions of seconds and zone, which are read separately."""
    return re.sub(r"[.,]%f|\s*%z", "", text)


def _read(cells: pa.Array, text: str) -> NDArray[np.datetime64]:
    import pyarrow.compute as pc

    fraction_ns = np.zeros(len(cells), np.int64)
    if pc.any(pc.match_substring_regex(cells, _FRACTION)).as_py():
        part = pc.struct_field(pc.extract_regex(cells, _FRACTION), "fraction")
        digits = pc.utf8_rpad(pc.fill_null(part, "0"), 9, "0")
        fraction_ns = digits.cast("int64").to_numpy(zero_copy_only=False)
        cells = pc.replace_substring_regex(cells, _FRACTION, r"\1")
    times = pc.strptime(cells, format=text, unit="s", error_is_null=True)
    if order := re.match(r"%([dmY])\W%([dmY])\W%([dmY])", text):  # 31 February isn't 3 March
        names = "".join(order.groups())
        parts = pc.extract_regex(
            cells, r"^(?P<{}>\d{{1,4}})\W(?P<{}>\d{{1,4}})\W(?P<{}>\d{{1,4}})".format(*names)
        )
        day = pc.struct_field(parts, "d").cast("int64")
        times = pc.if_else(pc.equal(pc.day(times), day), times, None)
    whole_s = np.asarray(times).astype("datetime64[s]")
    whole_s[np.abs(whole_s.astype(np.int64)) > MOST_S] = np.datetime64("NaT")
    whole_ns: NDArray[np.datetime64] = whole_s.astype("datetime64[ns]")
    whole_ns += fraction_ns.astype("timedelta64[ns]")
    return whole_ns


def _formats_of(cells: pa.Array) -> tuple[list[str], str]:
    """Return the possible formats of cells, and one cell; two formats if ambiguous.

    Day and month are distinguished by a number above 12, by consecutive days, or by dots, which are
    written only with the day first.
    """
    head = (cell for cell in cells[:HEAD_CELLS].to_pylist() if cell)
    written, example = next(((m, c) for c in head if (m := _WRITTEN.fullmatch(c))), (None, ""))
    if written is None:
        return [], ""
    mark, half = written["mark"], written["half"]
    clock = "%I:%M" if half else "%H:%M"
    seconds = ":%S" if written["seconds"] else ""
    tail = f"{written['between']}{clock}{seconds}{' %p' if half else ''}"
    first, _, last = written["date"].split(mark)
    if len(first) == 4:
        return [f"%Y{mark}%m{mark}%d{tail}"], example
    if len(last) != 4:
        return [], example  # 26/01/15: two digits may be day, month or year
    formats = [f"%d{mark}%m{mark}%Y{tail}", f"%m{mark}%d{mark}%Y{tail}"]
    day_first, month_first = (_read(cells, text) for text in formats)
    lost = [int(np.isnat(times).sum()) for times in (day_first, month_first)]
    if lost[0] != lost[1]:
        return [formats[int(np.argmin(lost))]], example
    gaps = [_longest_gap(times) for times in (day_first, month_first)]
    if min(gaps) < DAY and max(gaps) > 27 * DAY:
        return [formats[int(np.argmin(gaps))]], example
    return (formats[:1] if mark == "." else formats), example


def _longest_gap(times: NDArray[np.datetime64]) -> np.timedelta64:
    steps = np.abs(np.diff(times[~np.isnat(times)]))
    return np.timedelta64(steps.max() if steps.size else 0, "ns")


@dataclass(frozen=True, eq=False)
class Times:
    """Times in ns, and which of them could be read.

    They may be fewer than the cells: the last ones may depend on those that follow.
    """

    t_ns: Int64Array
    ok: NDArray[np.bool_]


class TimeReader:
    """Reads a column of times, piece by piece; the first piece determines their form.

    Parameters
    ----------
    where : str
    timezone : str, optional
        IANA name of the zone of times that have none; UTC if None.
    notes : Notes
    time_format : str, optional
        Of ``strptime``; found from the cells if None.
    utc : bool
        Whether the column's name says UTC; a zone that is given or written overrides it.
    """

    def __init__(
        self,
        where: str,
        timezone: str | None,
        notes: Notes,
        time_format: str | None = None,
        *,
        utc: bool = False,
    ) -> None:
        self._where, self._timezone, self._notes = where, timezone, notes
        self._utc = utc
        self._written = WrittenTimes(where, time_format, notes)
        self._format = time_format
        self._before_ns = np.empty(0, np.int64)
        self._unit_ns: int | None = None
        self._form = ""
        self._any = False
        self.absolute = True
        """Whether times are since 1970, rather than since an unknown start."""

    def read(self, cells: pa.Array, *, more: bool = False) -> Times:
        """Read the next cells; with ``more`` to come, only those that later cells can't affect.

        Raises
        ------
        ReferenceFormatError
            If hardly any cell of the first piece is a time, if day and month can't be
            distinguished, or if times without a zone jump as daylight saving does.
        """
        if not self._form:
            self._form = "text" if self._format else _form_of(cells)
            if self._form == "numbers":
                self._find_unit(numbers(cells))
        if self._form == "numbers":
            return self._from_numbers(numbers(cells))
        if self._form == "stamps":
            local, offset_s = _from_stamps(cells)
        else:
            texts, offset_s = _without_zones(cells)
            if not self._written.knows_format(texts):
                if more:
                    return Times(np.empty(0, np.int64), np.empty(0, np.bool_))
                raise self._written.ambiguity
            local = self._written.read(texts)
        return self._from_local(local, offset_s, cells, more)

    def check(self) -> None:
        """Refuse times whose day and month can't be distinguished so far."""
        if self._form == "text" and not self._written.known:
            raise self._written.ambiguity

    def _find_unit(self, values: FloatArray) -> None:
        typical = float(np.nanmedian(np.abs(values)))
        self._unit_ns = next((ns for least, ns in _UNITS if typical >= least), None)
        self.absolute = self._unit_ns is not None
        if self._timezone:
            self._notes.say("--timezone has no bearing on times given as numbers")

    def _from_numbers(self, values: FloatArray) -> Times:
        scale = self._unit_ns or NS_PER_S
        ok = np.abs(values) < 2.0**62 / scale
        # Split into whole and fractional units: a double resolves Unix ns only to 0.25 µs.
        whole = np.floor(np.where(ok, values, 0.0))
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
                f"expected {self._format or ACCEPTED}; see --time-format and --time-column",
            )
        t_ns = np.where(ok, local.astype(np.int64), 0)
        naive = np.isnan(offset_s) & ok
        t_ns -= np.where(np.isnan(offset_s), 0.0, offset_s).astype(np.int64) * NS_PER_S
        if not naive.any():
            return Times(t_ns, ok)
        if self._timezone is None and self._utc:
            self._notes.say("times are UTC, as their column is called")
            return Times(t_ns, ok)
        self._notes.say(f"times without a zone taken as {self._timezone or 'UTC'}")
        if self._timezone is None:
            self._notes.say(NO_ZONE)
            self._check_jumps(t_ns[naive])
            return Times(t_ns, ok)
        rows = np.flatnonzero(naive)
        done = settled(t_ns[rows], self._timezone) if more else rows.size
        end = t_ns.size if done == rows.size else rows[done]
        t_ns[rows[:done]], ok[rows[:done]] = to_utc(t_ns[rows[:done]], self._timezone, self._notes)
        return Times(t_ns[:end], ok[:end])

    def _check_jumps(self, local_ns: Int64Array) -> None:
        """Refuse times without a zone that can't be UTC."""
        joined = np.concatenate([self._before_ns, local_ns])
        if jump := find_jump(joined):
            at = str(np.datetime64(jump.local_ns, "ns").astype("datetime64[m]")).replace("T", " ")
            raise ReferenceFormatError(
                f"{self._where}: the hour from {at} is {jump.what}, as by daylight saving, and the "
                "times tell no zone: give --timezone",
                f"for example {jump.zone}; UTC, if they are UTC",
            )
        self._before_ns = joined[np.abs(joined - joined[-1]) <= ENDS_NS]


def _form_of(cells: pa.Array) -> str:
    import pyarrow as pa

    if pa.types.is_timestamp(cells.type) or pa.types.is_date(cells.type):
        return "stamps"
    return "numbers" if np.isfinite(numbers(cells[:HEAD_CELLS])).mean() > 0.5 else "text"


def _from_stamps(cells: pa.Array) -> tuple[NDArray[np.datetime64], FloatArray]:
    """Return Arrow's time stamps; those with a zone are UTC already, an offset of 0."""
    import pyarrow as pa

    zoned = getattr(cells.type, "tz", None) is not None
    try:
        local = _instants(cells)
    except pa.ArrowInvalid:
        raise ReferenceFormatError(
            "times lie outside the years 1677 to 2262", "is the unit of the time column right?"
        ) from None
    return local, np.full(len(cells), 0.0 if zoned else np.nan)


def _without_zones(cells: pa.Array) -> tuple[pa.Array, FloatArray]:
    """Return cells of local times, and their zones' offsets (s, positive east); NaN for none."""
    import pyarrow.compute as pc

    offset_s = np.full(len(cells), np.nan)
    if pc.any(pc.match_substring_regex(cells, _ZONED)).as_py():
        parts = pc.extract_regex(cells, _ZONED)
        zones = pc.struct_field(parts, "zone").dictionary_encode()
        east = np.array([_seconds_east(zone) for zone in zones.dictionary.to_pylist()] + [np.nan])
        offset_s = east[zones.indices.fill_null(-1).to_numpy(zero_copy_only=False)]
        cells = pc.coalesce(pc.struct_field(parts, "local"), cells)
    return cells, offset_s


def _seconds_east(zone: str) -> int:
    """Return the offset of Z, UTC, GMT, ±hh, ±hhmm or ±hh:mm."""
    if zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "")
    east = int(digits[:2]) * 3600 + int(digits[2:] or 0) * 60
    return -east if zone[0] == "-" else east
