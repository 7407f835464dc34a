"""Settings of recordings: file rotation, retention, alarms, and limits of free disk space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rsenf.errors import UsageError

ALARMS = "*/alarm"


def _check_positive(**values: float | None) -> None:
    for name, value in values.items():
        if value is not None and not 0 < value < float("inf"):
            raise UsageError(f"{name} {value}: a finite number above 0")


@dataclass(frozen=True)
class Rotation:
    """When the next file of an archive begins. Also at midnight, UTC.

    Parameters
    ----------
    every_s : float
        Longest duration of a file, by this host's clock.
    size_mb : float
        Largest size of a file.
    """

    # For validation by pydantic: unknown keys are errors.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    every_s: float = 3600.0
    size_mb: float = 1000.0

    def __post_init__(self) -> None:
        _check_positive(every_s=self.every_s, size_mb=self.size_mb)


@dataclass(frozen=True)
class Retention:
    """Which files of an archive are deleted; none by default.

    Parameters
    ----------
    days : float, optional
        Age at which a file is deleted.
    disk_share : float, optional
        Share of the whole disk that the archive may use; less if too little space is free.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    days: float | None = None
    disk_share: float | None = None

    def __post_init__(self) -> None:
        _check_positive(days=self.days, disk_share=self.disk_share)
        if self.disk_share is not None and self.disk_share > 1:
            raise UsageError(f"disk_share {self.disk_share}: at most 1, the whole disk")


@dataclass(frozen=True)
class AlarmSettings:
    """What triggers an alarm, and which time around it is exempt from retention.

    Parameters
    ----------
    trigger : str
        Key expression below the site; a message there is an alarm, unless it ends one.
    before_s : float
        Time before an alarm that belongs to it.
    after_s : float
        Time after an alarm that belongs to it.
    only : bool
        Record nothing but alarms: other messages stay in memory for a while, then are dropped.
    memory_mb : float
        Memory for such messages of each camera.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    trigger: str = ALARMS
    before_s: float = 120.0
    after_s: float = 60.0
    only: bool = False
    memory_mb: float = 256.0

    def __post_init__(self) -> None:
        _check_positive(before_s=self.before_s, after_s=self.after_s, memory_mb=self.memory_mb)


@dataclass(frozen=True)
class DiskLimits:
    """Limits of free disk space.

    Parameters
    ----------
    warn_mb : float
        Free space below which there is a warning; at most 10 % of the disk.
    stop_mb : float
        Free space below which the recording ends; at most 1 % of the disk.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    warn_mb: float = 2000.0
    stop_mb: float = 100.0

    def __post_init__(self) -> None:
        _check_positive(warn_mb=self.warn_mb, stop_mb=self.stop_mb)
