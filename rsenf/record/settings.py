"""What a recording may be told: when a new file begins, what is kept, how full a disk may be."""

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
    """When the next file of an archive begins; at midnight, UTC, in any case.

    Parameters
    ----------
    every_s : float
        Longest time in one file, by this host's clock.
    size_mb : float
        Largest file.
    """

    # Read by whoever validates a configuration file: a misspelt key is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    every_s: float = 3600.0
    size_mb: float = 1000.0

    def __post_init__(self) -> None:
        _check_positive(every_s=self.every_s, size_mb=self.size_mb)


@dataclass(frozen=True)
class Retention:
    """What of an archive is deleted; everything is kept by default.

    Parameters
    ----------
    days : float, optional
        Age at which a file goes.
    disk_share : float, optional
        Of the whole disk, that the archive may take; less where others leave too little free.
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
    """What an alarm is, and how much about it is kept whatever its age.

    Parameters
    ----------
    trigger : str
        Key expression below the site; a message there is an alarm, unless it says that one ended.
    before_s : float
        How much before an alarm belongs to it.
    after_s : float
        How much after an alarm belongs to it.
    only : bool
        Write nothing else: what comes waits in memory until an alarm, or is forgotten.
    memory_mb : float
        Most that may wait for each camera.
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
    """How little of the disk may be left.

    Parameters
    ----------
    warn_mb : float
        Below it there is a warning; no more than 10 % of the disk.
    stop_mb : float
        Below it the recording ends; no more than 1 % of the disk.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    warn_mb: float = 2000.0
    stop_mb: float = 100.0

    def __post_init__(self) -> None:
        _check_positive(warn_mb=self.warn_mb, stop_mb=self.stop_mb)
