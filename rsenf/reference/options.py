"""How a file is meant to be read, where it doesn't say so itself."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.errors import UsageError
from rsenf.reference.local_time import zone_of

STAMPS = ("start", "centre")


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of reading; their meaning is told at :func:`rsenf.reference.read_reference`.

    Raises
    ------
    UsageError
        When one of them can't be meant so.
    """

    timezone: str | None = None
    step_s: float | None = None
    column: str | None = None
    nominal_hz: float | None = None
    stamp: str = "start"
    start_utc_ns: int = 0

    def __post_init__(self) -> None:
        if self.stamp not in STAMPS:
            raise UsageError(f"no stamp {self.stamp!r}", "one of start, centre")
        if self.step_s is not None and not 0 < self.step_s < 86400:
            raise UsageError(f"a step of {self.step_s:g} s between samples", "give it in seconds")
        if self.nominal_hz not in (None, 50, 60):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz", "50 or 60")
        if self.timezone is not None:
            zone_of(self.timezone)
