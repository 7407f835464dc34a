"""Options of reading a file, for what the file doesn't state itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from rsenf.errors import UsageError
from rsenf.reference.local_time import zone_of
from rsenf.reference.written_times import checked_format

Stamp = Literal["start", "centre"]


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of reading.

    Parameters
    ----------
    timezone : str, optional
        IANA name of the zone of times that have none; UTC if None.
    step_s : float, optional
        Time between samples; needed if there is no time column.
    column : str, optional
        Name of the frequency column, if it isn't one of the usual names.
    time_column : str, optional
        Name of the time column, if it isn't found by its name or content.
    time_format : str, optional
        Format of the times, as in ``strptime``, such as %d/%m/%Y %H:%M:%S.
    nominal_hz : float, optional
        50 or 60; found from the values if None, unless they are deviations from it.
    stamp : {'start', 'centre'}
        The part of a sample's interval that its time stamp denotes.
    assumed_hz : float, optional
        Nominal frequency of deviations if ``nominal_hz`` is None; other values may differ from it.
    start_utc_ns : int
        Start of a reference without dated times, UTC since 1970; 0 for unknown.

    Raises
    ------
    UsageError
        If an option is invalid.
    """

    timezone: str | None = None
    step_s: float | None = None
    column: str | None = None
    time_column: str | None = None
    time_format: str | None = None
    nominal_hz: float | None = None
    stamp: Stamp = "start"
    assumed_hz: float | None = None
    start_utc_ns: int = 0

    @property
    def deviations_from_hz(self) -> float | None:
        """Nominal frequency that deviations refer to; None if it isn't given."""
        return self.nominal_hz or self.assumed_hz

    def __post_init__(self) -> None:
        if self.stamp not in get_args(Stamp):
            raise UsageError(f"no stamp {self.stamp!r}", "one of start, centre")
        if self.step_s is not None and not 0 < self.step_s < 86400:
            raise UsageError(f"a step of {self.step_s:g} s between samples", "give it in seconds")
        if self.nominal_hz not in (None, 50, 60):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz", "50 or 60")
        if self.timezone is not None:
            zone_of(self.timezone)
        if self.time_format is not None:
            checked_format(self.time_format)
