"""Which stretches of time a camera's alarms refer to; they outlive every rule of retention.

One line of JSON for each alarm, in ``site/camera/alarms.jsonl``. Who takes a line out gives what
it refers to free.
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
    """What an alarm refers to."""

    from_ns: int
    to_ns: int
    why: str

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Whether it has a moment in common with another stretch of time."""
        return self.from_ns <= last_ns and first_ns <= self.to_ns


def add_alarm(root: Path, camera: Camera, span: AlarmSpan) -> None:
    """Write an alarm down, and wait for the disk.

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
            if file.read(1) != b"\n":  # the line before broke off
                file.write(b"\n")
        file.write(json.dumps(entry).encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


def alarms_of(root: Path, camera: Camera) -> list[AlarmSpan]:
    """Return a camera's alarms in the order of their coming; a line that broke off is none."""
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
