"""Put a report together, and put it in its place whole."""

from __future__ import annotations

import json
from pathlib import Path

from rsenf.report.recording_time.case import Case
from rsenf.report.recording_time.document import document_of, verdict_bytes
from rsenf.report.recording_time.folder import NUMBERS, PAGE, VERDICT, check_folder
from rsenf.report.recording_time.page import page_of
from rsenf.report.recording_time.pictures import draw_pictures
from rsenf.whole_file import whole_folder


def write_report(path: Path, case: Case, made_utc: str) -> None:
    """Write a report; an earlier one in the same folder is replaced when this one is complete.

    Parameters
    ----------
    path : Path
        Folder to write: a new one, an empty one, or an earlier report.
    case : Case
    made_utc : str
        When it was made. The same case at the same moment gives the same bytes.

    Raises
    ------
    UsageError
        When the folder is one that must not be replaced.
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
        # A file's name may hold bytes that are no text.
        (folder / PAGE).write_text(page, encoding="utf-8", errors="backslashreplace")
