"""The journal of a long run: one JSON line per task, appended when it is done, never rewritten.

The last line of a task counts.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any, Self

from rsenf.errors import InputError, RecordingError, UsageError

Record = dict[str, Any]


def read_records(path: Path) -> dict[str, Record]:
    """Read the records by key; an unfinished last line is ignored.

    Raises
    ------
    InputError
        If another line isn't a record.
    """
    if not path.exists():
        return {}
    *lines, _ = path.read_bytes().split(b"\n")
    records = {}
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
            records[record["key"]] = record
        except (ValueError, TypeError, KeyError, RecursionError) as exc:
            raise InputError(
                f"{path}:{number}: not a record of what was done", "delete the line, or the file"
            ) from exc
    return records


class Journal:
    """A file of records, open for appending; its content is kept.

    Raises
    ------
    RecordingError
        If it can't be written.
    UsageError
        If another run is writing it.
    InputError
        If it holds something else.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("ab")
        except OSError as exc:
            raise RecordingError(
                f"can't write {path}: {exc.strerror}", "choose another --out"
            ) from exc
        try:
            _take(self._file, path)
            self.records = read_records(path)
            self._file.truncate(path.read_bytes().rfind(b"\n") + 1)  # to the last whole line
        except BaseException:
            self._file.close()
            raise

    def add(self, record: Record) -> None:
        """Append a record; it is on disk when this returns.

        Raises
        ------
        RecordingError
            If it can't be written.
        """
        line = json.dumps(record, allow_nan=False, separators=(",", ":"))
        try:
            self._file.write(line.encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as exc:
            raise RecordingError(
                f"can't write {self.path}: {exc.strerror}", "what it has so far is kept"
            ) from exc
        self.records[record["key"]] = record

    def of(self, keys: Iterable[str]) -> list[Record]:
        """Return the records of these keys, in their order, if they exist."""
        return [self.records[key] for key in keys if key in self.records]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with contextlib.suppress(OSError):  # add has told of it
            self._file.close()


def _take(file: IO[bytes], path: Path) -> None:
    """Lock a file for this process as long as it is open.

    Without effect on file systems that have no locks.
    """
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UsageError(
            f"{path}: another run is writing it", "wait for its end, or choose another --out"
        ) from None
    except OSError:
        return
