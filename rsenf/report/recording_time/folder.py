"""Which folders a report may be written to."""

from __future__ import annotations

import json
import os
from pathlib import Path

from rsenf.errors import UsageError

SCHEMA = "rsenf.report.recording_time"
PAGE, NUMBERS, VERDICT = "report.html", "report.json", "result.json"


def check_folder(path: Path) -> None:
    """Refuse a folder that a report would spoil, or that can't be made.

    A new folder, an empty one and an earlier report are fine. A folder with anything else in it is
    not, were it only a note beside the earlier report: replacing it would lose that.

    Raises
    ------
    UsageError
    """
    path = path.resolve()
    if path == Path.cwd():
        raise UsageError(f"--report {path}: this is the current folder", "name one inside it")
    if not path.parent.is_dir():
        raise UsageError(f"--report {path}: no such folder as {path.parent}", "make it first")
    if path.exists() and not path.is_dir():
        raise UsageError(f"--report {path}: this is a file", "name a folder")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise UsageError(f"--report {path}: can't write in {path.parent}", "look at its rights")
    foreign = sorted(_names_in(path) - _names_of_report(path))
    if foreign:
        more = f" and {len(foreign) - 1} more" if foreign[1:] else ""
        raise UsageError(
            f"--report {path}: holds what is no report: {foreign[0]}{more}",
            "name a new or an empty folder",
        )


def _names_in(path: Path) -> set[str]:
    return {p.name for p in path.iterdir()} if path.is_dir() else set()


def _names_of_report(path: Path) -> set[str]:
    """Names of the files of the report in a folder; none when there is no report in it."""
    try:
        document = json.loads((path / NUMBERS).read_text(encoding="utf-8"))
        ours = document["schema"] == SCHEMA
        return {str(name) for name in document["files"]} if ours else set()
    except (OSError, ValueError, KeyError, TypeError):
        return set()
