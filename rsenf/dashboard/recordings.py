"""Archived recordings of an alarm, for download and replay."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from rsenf.dashboard.alarm_board import Raised
from rsenf.record.archive.layout import ArchivedFile, archived_files
from rsenf.timebase import NS_PER_S

MCAP_END = b"\x89MCAP0\r\n"
LEAD_S = 10.0  # replay starts this long before the alarm
AROUND_NS = 60 * NS_PER_S  # the recording of an alarm starts within this time of it
MOST = 8


def files_about(archive: Path, raised: Raised) -> list[dict[str, Any]]:
    """List the files that contain an alarm, for JSON; those recorded for alarms come first.

    Parameters
    ----------
    archive : Path
        Folder of the archive.
    raised : Raised
    """
    of_feed = [file for file in archived_files(archive) if str(file.camera) == raised.feed]
    kept = [f for f in of_feed if f.of_alarm and abs(f.start_ns - raised.start_ns) < AROUND_NS]
    running = _covering([f for f in of_feed if not f.of_alarm], raised)
    return [_plain(archive, file, raised) for file in [*kept, *running][:MOST]]


def file_named(archive: Path, name: str) -> Path | None:
    """Return the archive's file with a relative path; None for any other path.

    A link that leads out of the archive is none of its files.
    """
    paths = (file.path for file in archived_files(archive))
    path = next((path for path in paths if path.relative_to(archive).as_posix() == name), None)
    return path if path and path.resolve().is_relative_to(archive.resolve()) else None


def _covering(files: list[ArchivedFile], raised: Raised) -> list[ArchivedFile]:
    """Return the files that overlap with an alarm. Each file lasts until the next one starts."""
    ends_ns = [file.start_ns for file in files[1:]]
    ends_ns += [_written_ns(file.path) for file in files[-1:]]
    return [
        file
        for file, end_ns in zip(files, ends_ns, strict=True)
        if file.start_ns <= raised.end_ns and end_ns >= raised.start_ns
    ]


def _written_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:  # deleted by retention meanwhile
        return 0


def _plain(archive: Path, file: ArchivedFile, raised: Raised) -> dict[str, Any]:
    start_s = 0.0
    if not file.of_alarm:  # a file of an alarm starts shortly before it anyway
        start_s = max(0.0, (raised.start_ns - file.start_ns) / NS_PER_S - LEAD_S)
    from_there = f" --start-s {start_s:.0f}" if start_s >= 1 else ""
    size_bytes, is_whole = state_of(file.path)
    return {
        "name": file.path.name,
        "url": "recordings/" + file.path.relative_to(archive).as_posix(),
        "size_mb": round(size_bytes / 1e6, 1),
        "is_whole": is_whole,
        "of_alarm": file.of_alarm,
        "replay": f"rsenf replay {shlex.quote(str(file.path))}{from_there}",
    }


def state_of(path: Path) -> tuple[int, bool]:
    """Return the size of a recording in bytes, and whether it has been closed."""
    try:
        with path.open("rb") as file:
            size_bytes = file.seek(0, 2)
            file.seek(-min(len(MCAP_END), size_bytes), 2)
            return size_bytes, file.read() == MCAP_END
    except FileNotFoundError:
        return 0, False
