"""Limits of a recording: size and age of its files, what alarms keep, and free disk space."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NamedTuple

from rsenf.errors import RecordingError, UsageError

ALARMS = "*/alarm"
CHECK_EVERY_S = 1.0
WARN_SHARE, STOP_SHARE = 0.1, 0.01
MB = 1_000_000


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


class Usage(NamedTuple):
    """Size of a disk, and its free space, in bytes."""

    total: int
    free: int


def disk_usage(folder: Path) -> Usage:
    """Return the usage of the disk that holds a folder."""
    found = shutil.disk_usage(folder)
    return Usage(found.total, found.free)


def low_bytes(limits: DiskLimits, total_bytes: int) -> float:
    """Return the free space, in bytes, below which there is a warning."""
    return min(limits.warn_mb * MB, WARN_SHARE * total_bytes)


class DiskGuard:
    """Warns before a disk is full, and stops a recording while its end can still be written.

    Parameters
    ----------
    folder : Path
        Folder of the recording.
    limits : DiskLimits
    warn : callable
        Called with a text each time that the free space falls below the warning limit.
    usage : callable
        Returns size and free space of the disk.
    clock_s : callable
        A monotonic clock.
    """

    def __init__(
        self,
        folder: Path,
        limits: DiskLimits,
        warn: Callable[[str], None],
        *,
        usage: Callable[[Path], Usage] = disk_usage,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._folder, self._limits, self._warn = folder, limits, warn
        self._usage, self._clock_s = usage, clock_s
        self._begun: tuple[float, int] | None = None
        self._checked_s = -float("inf")
        self._warned = False

    def check(self) -> None:
        """Check the free space at most once a second. To be called often.

        Raises
        ------
        RecordingError
            When the free space is below the stop limit.
        """
        now_s = self._clock_s()
        if now_s - self._checked_s < CHECK_EVERY_S:
            return
        self._checked_s = now_s
        total, free = self._usage(self._folder)
        self._begun = self._begun or (now_s, free)
        if free < min(self._limits.stop_mb * MB, STOP_SHARE * total):
            raise RecordingError(
                f"{self._folder}: the disk is full but for {free / MB:.1f} MB; recording stopped, "
                "and what was recorded is whole",
                "free some space on that disk, then record on",
            )
        low = free < low_bytes(self._limits, total)
        if low and not self._warned:
            self._warn(
                f"{self._folder}: {free / MB:.0f} MB are left on the disk{self._lasts(free)}"
            )
        self._warned = low

    def _lasts(self, free: int) -> str:
        begun_s, free_then = self._begun or (self._checked_s, free)
        used, took_s = free_then - free, self._checked_s - begun_s
        if used <= 0 or took_s <= 0:
            return ""
        return f", enough for {free / used * took_s / 60:.0f} minutes"
