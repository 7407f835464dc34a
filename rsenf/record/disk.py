"""Looks at the disk while something is recorded on it: a warning in time, an end in order."""

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
    """How large a disk is, and how much of it is free, in bytes."""

    total: int
    free: int


def disk_usage(folder: Path) -> Usage:
    """Look at the disk that a folder lies on."""
    found = shutil.disk_usage(folder)
    return Usage(found.total, found.free)


def low_bytes(limits: DiskLimits, total_bytes: int) -> float:
    """Below so much free space there is a warning."""
    return min(limits.warn_mb * MB, WARN_SHARE * total_bytes)


class DiskGuard:
    """Warns before a disk is full, and stops a recording while its end can still be written.

    Parameters
    ----------
    folder : Path
        Where is recorded.
    limits : DiskLimits
        How little may be left.
    warn : callable
        Told in words, once each time that the space falls below the first limit.
    usage : callable
        Tells how large the disk is and what is free.
    clock_s : callable
        Any clock that only goes on.
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
        """Look, when a second has passed since the last time. To be called often.

        Raises
        ------
        RecordingError
            When less is left than the second limit.
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
