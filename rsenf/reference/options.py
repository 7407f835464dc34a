"""How a file is meant to be read, where it doesn't say so itself."""

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
        IANA name of the zone of times that don't tell their own; UTC when not given.
    step_s : float, optional
        Time between samples; needed when there is no time column.
    column : str, optional
        Name of the frequency column, when it isn't found by its name.
    time_column : str, optional
        Name of the time column, when it isn't found by its name or by what is in it.
    time_format : str, optional
        How times are written, as ``strptime`` takes it, such as %d/%m/%Y %H:%M:%S.
    nominal_hz : float, optional
        50 or 60; told from the values when not given, unless they are deviations from it.
    stamp : {'start', 'centre'}
        Which part of its sample's interval a time stamp names.
    assumed_hz : float, optional
        What deviations are from where ``nominal_hz`` isn't given; other values may differ from it.
    start_utc_ns : int
        Start of a reference that doesn't tell its own, UTC since 1970; 0 for unknown.

    Raises
    ------
    UsageError
        When one of them can't be meant so.
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
        """What deviations are from, as far as anybody says."""
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
