"""Deletes the oldest files of an archive, by age and by the share of the disk that they take."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from rsenf.record.archive.alarms import AlarmSpan, alarms_of
from rsenf.record.archive.layout import ArchivedFile, Camera, archived_files
from rsenf.record.disk import Usage, disk_usage
from rsenf.record.held import is_held
from rsenf.record.settings import Retention
from rsenf.timebase import nanoseconds

DAY_S = 86_400


class _Aged(NamedTuple):
    file: ArchivedFile
    size_bytes: int
    last_ns: int  # when it was last written


class Keeper:
    """Applies the rules; never deletes a file being written, nor one that an alarm refers to.

    Parameters
    ----------
    root : Path
        The archive.
    rules : Retention
        What may stay.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.
    usage : callable
        Tells how large the disk is and what is free.
    """

    def __init__(
        self,
        root: Path,
        rules: Retention,
        clock_ns: Callable[[], int],
        usage: Callable[[Path], Usage] = disk_usage,
    ) -> None:
        self._root, self._rules, self._clock_ns, self._usage = root, rules, clock_ns, usage

    def apply(self) -> list[Path]:
        """Delete what has to go; returns it, the oldest first.

        Raises
        ------
        OSError
            When a file can't be deleted.
        """
        files = [aged for aged in map(_age, archived_files(self._root)) if aged is not None]
        too_many = sum(aged.size_bytes for aged in files) - self._most_bytes()
        alarms = {c: alarms_of(self._root, c) for c in {aged.file.camera for aged in files}}
        gone = []
        for aged in files:
            due = too_many > 0 or aged.last_ns < self._oldest_ns()
            if due and not _stays(aged, alarms):
                aged.file.path.unlink(missing_ok=True)
                too_many -= aged.size_bytes
                gone.append(aged.file.path)
        for folder in {path.parent for path in gone}:
            with contextlib.suppress(OSError):
                folder.rmdir()  # a day of which nothing is left
        return gone

    def _oldest_ns(self) -> int:
        days = self._rules.days
        return 0 if days is None else self._clock_ns() - nanoseconds(days * DAY_S)

    def _most_bytes(self) -> float:
        share = self._rules.disk_share
        return float("inf") if share is None else share * self._usage(self._root).total


def _age(file: ArchivedFile) -> _Aged | None:
    try:
        found = file.path.stat()
    except FileNotFoundError:  # somebody else applies these rules too
        return None
    return _Aged(file, found.st_size, found.st_mtime_ns)


def _stays(aged: _Aged, alarms: dict[Camera, list[AlarmSpan]]) -> bool:
    spans = alarms[aged.file.camera]
    if any(span.covers(aged.file.start_ns, aged.last_ns) for span in spans):
        return True
    try:
        return is_held(aged.file.path)
    except FileNotFoundError:
        return False
