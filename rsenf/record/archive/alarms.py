"""The time spans of a camera's alarms, which are exempt from retention.

Stored as one line of JSON for each alarm, in ``site/camera/alarms.jsonl``. Removing a line permits
retention to delete its time span.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NamedTuple

from rsenf.record.archive.layout import Camera

VERSION = 1
NAME = "alarms.jsonl"


class AlarmSpan(NamedTuple):
    """The time span of an alarm, UTC in ns, and its reason."""

    from_ns: int
    to_ns: int
    why: str

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Whether it overlaps with another time span."""
        return self.from_ns <= last_ns and first_ns <= self.to_ns


def add_alarm(root: Path, camera: Camera, span: AlarmSpan) -> None:
    """Append an alarm to the camera's file, and wait for the disk.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    camera : Camera
    span : AlarmSpan

    Raises
    ------
    OSError
        When it can't be written.
    """
    path = root / camera.site / camera.name / NAME
    path.parent.mkdir(parents=True, exist_ok=True)
    entry = {
        "version": VERSION,
        "from_ns": str(span.from_ns),
        "to_ns": str(span.to_ns),
        "why": span.why,
    }
    with open(path, "a+b") as file:
        file.seek(0, os.SEEK_END)
        if file.tell():
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":  # the previous line is truncated
                file.write(b"\n")
        file.write(json.dumps(entry).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def alarms_of(root: Path, camera: Camera) -> list[AlarmSpan]:
    """Return a camera's alarms in order of arrival; invalid lines are skipped."""
    try:
        lines = (root / camera.site / camera.name / NAME).read_bytes().splitlines()
    except FileNotFoundError:
        return []
    return [span for span in map(_read, lines) if span is not None]


def _read(line: bytes) -> AlarmSpan | None:
    try:
        entry = json.loads(line)
        return AlarmSpan(int(entry["from_ns"]), int(entry["to_ns"]), str(entry["why"]))
    except (ValueError, KeyError, TypeError):
        return None
