"""Parses times as loggers and spreadsheets write them: format, and order of day and month."""

from __future__ import annotations

import re
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import ReferenceFormatError, UsageError
from rsenf.reference.notes import Notes

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
        Name of the file, for error messages.
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
                return np.asarray(cells.cast(pa.timestamp("ns")).to_numpy(zero_copy_only=False))
            except pa.ArrowInvalid:
                pass
        if not self._formats:
            return np.full(len(cells), "NaT", "datetime64[ns]")
        return _read(cells, self._formats[0])


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
        parts = pc.extract_regex(cells, r"^(?P<{}>\d+)\W(?P<{}>\d+)\W(?P<{}>\d+)".format(*names))
        day = pc.struct_field(parts, "d").cast("int64")
        times = pc.if_else(pc.equal(pc.day(times), day), times, None)
    whole_ns: NDArray[np.datetime64] = np.asarray(times).astype("datetime64[ns]")
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
