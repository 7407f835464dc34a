"""Check of the folder that a report is written to."""

from __future__ import annotations

import json
import os
from pathlib import Path

from rsenf.errors import UsageError

SCHEMA = "rsenf.report.recording_time"
PAGE, NUMBERS, VERDICT = "report.html", "report.json", "result.json"


def check_folder(path: Path) -> None:
    """Check that a report may be written to a folder.

    Allowed are a new folder, an empty one, and one that holds an earlier report and nothing else:
    the folder is replaced as a whole, so other files in it would be lost.

    Raises
    ------
    UsageError
        When it isn't allowed, or the folder can't be made.
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
    """Return the file names of the report in a folder; empty if there is no report."""
    try:
        document = json.loads((path / NUMBERS).read_text(encoding="utf-8"))
        ours = document["schema"] == SCHEMA
        return {str(name) for name in document["files"]} if ours else set()
    except (OSError, ValueError, KeyError, TypeError):
        return set()
