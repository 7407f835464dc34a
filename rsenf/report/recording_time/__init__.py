"""The forensic report on the time of a recording: HTML page, JSON and pictures, in one folder.

In: a :class:`Basis` (verdict, estimates, reference, files, settings). Out: ``report.html``,
``report.json``, ``result.json`` and PNG files. It follows the ENFSI Guideline for Evaluative
Reporting in Forensic Science (2015): propositions, likelihood ratios, conditions.

Read ``words`` and ``document`` (report.json), which is filled from ``words`` and ``evidence``; then
``pictures``, and ``page`` (its sections); the folder is written here.
"""

from __future__ import annotations

import json
import os
import time
from datetime import UTC, datetime
from pathlib import Path

from rsenf.errors import UsageError
from rsenf.report.recording_time.document import (
    NUMBERS,
    PAGE,
    SCHEMA,
    VERDICT,
    document_of,
    verdict_bytes,
)
from rsenf.report.recording_time.page import page_of
from rsenf.report.recording_time.pictures import draw_pictures
from rsenf.report.recording_time.words import Basis, RecordingFacts, ReferenceFacts
from rsenf.whole_file import whole_folder

__all__ = [
    "Basis",
    "RecordingFacts",
    "ReferenceFacts",
    "check_folder",
    "moment_of_report",
    "write_report",
]


def write_report(path: Path, case: Basis, made_utc: str) -> None:
    """Write a report; an earlier one in the same folder is replaced once this one is complete.

    Raises
    ------
    UsageError
        When the folder must not be replaced.
    RecordingError
        When it can't be written.
    """
    pictures = draw_pictures(case)
    document = document_of(case, pictures, made_utc)
    page = page_of(document, pictures)
    numbers = json.dumps(document, indent=2, allow_nan=False) + "\n"
    check_folder(path)
    with whole_folder(path.resolve()) as folder:
        for picture in pictures:
            (folder / picture.file).write_bytes(picture.png)
        (folder / VERDICT).write_bytes(verdict_bytes(case))
        (folder / NUMBERS).write_text(numbers, encoding="utf-8")
        # A file name may contain bytes that are not valid text.
        (folder / PAGE).write_text(page, encoding="utf-8", errors="backslashreplace")


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
    held = {p.name for p in path.iterdir()} if path.is_dir() else set()
    foreign = sorted(held - _names_of_report(path))
    if foreign:
        more = f" and {len(foreign) - 1} more" if foreign[1:] else ""
        raise UsageError(
            f"--report {path}: holds what is no report: {foreign[0]}{more}",
            "name a new or an empty folder",
        )


def _names_of_report(path: Path) -> set[str]:
    """Return the file names of the report in a folder; empty if there is no report."""
    try:
        document = json.loads((path / NUMBERS).read_text(encoding="utf-8"))
        ours = document["schema"] == SCHEMA
        return {str(name) for name in document["files"]} if ours else set()
    except (OSError, ValueError, KeyError, TypeError):
        return set()


VARIABLE = "SOURCE_DATE_EPOCH"  # reproducible-builds.org/specs/source-date-epoch


def moment_of_report() -> str:
    """Return the present time, or that of ``SOURCE_DATE_EPOCH``, as ISO 8601 in UTC.

    Raises
    ------
    UsageError
        When the variable isn't a valid time.
    """
    epoch = os.environ.get(VARIABLE, "")
    try:
        return f"{datetime.fromtimestamp(int(epoch or time.time()), UTC):%Y-%m-%dT%H:%M:%SZ}"
    except (ValueError, OverflowError, OSError):
        raise UsageError(
            f"{VARIABLE}={epoch!r} in the environment is no moment", "whole seconds since 1970"
        ) from None
