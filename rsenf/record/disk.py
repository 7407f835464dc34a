"""Watches the free disk space while recording: warns early, and stops before the disk is full."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from rsenf.errors import RecordingError
from rsenf.record.settings import DiskLimits

CHECK_EVERY_S = 1.0
WARN_SHARE, STOP_SHARE = 0.1, 0.01
MB = 1_000_000


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
