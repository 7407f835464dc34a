"""Renders a report as one HTML page, and writes its folder as a whole.

The folder must hold nothing else; the time of the report may be set from outside.
"""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.errors import UsageError
from rsenf.report.pages import Picture, fill, setting
from rsenf.report.recording_time.document import (
    NUMBERS,
    PAGE,
    SCHEMA,
    VERDICT,
    Document,
    document_of,
    verdict_bytes,
)
from rsenf.report.recording_time.pictures import draw_pictures
from rsenf.report.recording_time.words import Case
from rsenf.report.verdict import ppm_text
from rsenf.whole_file import whole_folder

_WHOLE = re.compile(r"\d{4}-\d\d-\d\d [\d:.]+ UTC|± [\d.]+ s|--[a-z-]+")
_UNKNOWN = "not known"
_SPACE = "\N{NARROW NO-BREAK SPACE}"
_WORDS = {
    "match": "match",
    "no_match": "no match",
    "no_decision": "no decision",
    "supported": "claim supported",
    "refuted": "claim refuted",
    "undecidable": "claim undecidable",
}


class Section(NamedTuple):
    """A section of the page: ``sections/<id>.html.j2``, in which ``r`` is the document.

    ``short`` is its name in the table of contents. A section ``about`` a key of the document is
    left out if that is empty.
    """

    id: str
    title: str
    short: str = ""
    about: str = ""


# In the order of the page. To add one, add a template and a line here.
SECTIONS = (
    Section("case", "The case", "Case", about="case"),
    Section("evidence", "Weight of the evidence"),
    Section("claim", "The claim", about="claim"),
    Section("conditions", "What this is conditioned on", "Conditions"),
    Section("segments", "What seems to have been done to the recording", "Edits", about="edits"),
    Section("help", "What would help", about="what_would_help"),
    Section("pictures", "Pictures"),
    Section("candidates", "Candidates"),
    Section("camera", "The camera", "Camera"),
    Section("search", "The search", "Search"),
    Section("warnings", "Warnings"),
    Section("limits", "Known limits of the method", "Limits"),
    Section("inputs", "What this rests on", "Inputs"),
    Section("command", "The command, to copy", "Command", about="command"),
    Section("parameters", "Parameters in effect, and versions", "Parameters"),
    Section("terms", "Terms"),
)


def page_of(document: Document, pictures: Sequence[Picture]) -> str:
    """Render the page; all values are HTML-escaped.

    Parameters
    ----------
    document : Document
        Of :func:`rsenf.report.recording_time.document.document_of`; the page shows nothing else.
    pictures : sequence of Picture
        Those that the document lists, in the same order.
    """
    shown = [section for section in SECTIONS if not section.about or dict(document)[section.about]]
    template = Path(__file__).parent / "page.html.j2"
    return fill(template, pictures, _FILTERS, r=document, sections=shown)


def _known(write: Callable[..., str]) -> Callable[..., str]:
    """Make a filter return 'not known' for None."""

    def filled(value: Any, *more: Any) -> str:
        return _UNKNOWN if value is None else write(value, *more)

    return filled


def _fixed(value: float, decimals: int = 2) -> str:
    return f"{value:.{decimals}f}"


def _count(value: int) -> str:
    return f"{value:,}".replace(",", _SPACE)


def _utc(text: str) -> str:
    """Return ISO 8601 in a readable form; seconds keep their decimals."""
    return f"{text[:10]} {text[11:].rstrip('Z')} UTC"


def _power(log10: float) -> str:
    """Return a ratio as a power of ten."""
    return f"10^{log10:.1f}".replace("-", "\N{MINUS SIGN}")


def _unbroken(text: str) -> Any:
    """Prevent line breaks within times and options of a text."""
    from markupsafe import Markup, escape

    return Markup(_WHOLE.sub(r'<span class="whole">\g<0></span>', str(escape(text))))


def _duration(value: float) -> str:
    """Return seconds as days, hours, minutes and seconds, without those that are zero."""
    days, rest = divmod(value, 86400)
    hours, rest = divmod(rest, 3600)
    minutes, rest = divmod(rest, 60)
    parts = [(f"{days:.0f} d", days), (f"{hours:.0f} h", hours), (f"{minutes:.0f} min", minutes)]
    units = [text for text, size in parts if size]
    return " ".join([*units, *([f"{rest:.4g} s"] if rest or not units else [])])


def _stamps(container: Mapping[str, Any]) -> str:
    """Describe the time stamps of a video's frames."""
    if container["rate_basis"]:
        return f"none: they are counted at a rate that is {container['rate_basis']}"
    count = f"{_count(container['stamped_frames'])} frames have one"
    if container["median_s"] is None:
        return count
    first, usual, last = (
        f"{1e3 * container[f'{n}_s']:.3f}" for n in ("shortest", "median", "longest")
    )
    return f"{count}; from one to the next {first} to {last} ms, mostly {usual} ms"


_FILTERS: dict[str, Callable[..., str]] = {
    "fixed": _known(_fixed),
    "count": _known(_count),
    "utc": _known(_utc),
    "power": _known(_power),
    "ppm": _known(ppm_text),
    "unbroken": _unbroken,
    "percent": _known(lambda ratio, decimals=1: f"{100 * ratio:.{decimals}f} %"),
    "mhz": _known(lambda value: f"{1e3 * value:.3g} mHz"),
    "duration": _known(_duration),
    "setting": setting,
    "stamps": _stamps,
    "plain": lambda word: _WORDS.get(word, str(word)),
}


def write_report(path: Path, case: Case, made_utc: str) -> None:
    """Write a report; an earlier one in the same folder is replaced once this one is complete.

    Parameters
    ----------
    path : Path
        Folder to write: a new one, an empty one, or an earlier report.
    case : Case
    made_utc : str
        Time of the report. The same case with the same time gives the same bytes.

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
