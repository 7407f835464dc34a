"""The self-contained page of a batch: counts, a table that sorts by its headings, and settings.

``SHOWN`` defines the columns of each analysis: values with errors, in customary units.
"""

from __future__ import annotations

import base64
import hashlib
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rsenf.report.camera import decimals
from rsenf.report.pages import fill

Row = Mapping[str, Any]
_UNSURE_DECIMALS = 2  # decimals of a value without an error


@dataclass(frozen=True)
class Cell:
    """Text of a table cell, and its sort key: a number, a text, or None for unknown."""

    text: str
    key: float | str | None
    link: str = ""


@dataclass(frozen=True)
class Column:
    """A column of the page."""

    heading: str
    cell: Callable[[Row], Cell]
    number: bool = False
    badge: bool = False
    whole: bool = False  # no line breaks


def text(heading: str, name: str, *, whole: bool = False) -> Column:
    """Return a column of texts.

    Parameters
    ----------
    heading : str
    name : str
        Key of the row, here and in the other functions.
    whole : bool
        No line breaks.
    """

    def cell(row: Row) -> Cell:
        value = row[name]
        shown = "; ".join(value) if isinstance(value, list) else str(value or "").replace("_", " ")
        return Cell(shown, shown or None)

    return Column(heading, cell, whole=whole)


def figure(heading: str, name: str, std: str = "", scale: float = 1.0) -> Column:
    """Return a column of numbers, times ``scale``, with standard errors of the key ``std``."""

    def cell(row: Row) -> Cell:
        value, error = row[name], row[std] if std else None
        if value is None:
            return Cell("", None)
        if error is None:
            return Cell(f"{scale * value:.{_UNSURE_DECIMALS}f}", scale * value)
        places = decimals(scale * error)
        return Cell(f"{scale * value:.{places}f} ± {scale * error:.{places}f}", scale * value)

    return Column(heading, cell, number=True)


def small(heading: str, name: str, std: str = "") -> Column:
    """Return a column of numbers far below 1, with standard errors of the key ``std``."""

    def cell(row: Row) -> Cell:
        value, error = row[name], row[std] if std else None
        if value is None:
            return Cell("", None)
        return Cell(f"{value:.2e}" + (f" ± {error:.1e}" if error is not None else ""), value)

    return Column(heading, cell, number=True)


def between(heading: str, low: str, high: str, scale: float, places: int) -> Column:
    """Return a column of intervals."""

    def cell(row: Row) -> Cell:
        if row[low] is None or row[high] is None:
            return Cell("", None)
        lowest, highest = scale * row[low], scale * row[high]
        return Cell(f"{lowest:.{places}f} to {highest:.{places}f}", lowest)

    return Column(heading, cell, number=True)


def share(heading: str, part: str, whole: str) -> Column:
    """Return a column of counts, as 'part of whole'."""

    def cell(row: Row) -> Cell:
        if row[part] is None:
            return Cell("", None)
        return Cell(f"{row[part]} of {row[whole]}", row[part])

    return Column(heading, cell, number=True)


def file(heading: str, name: str) -> Column:
    """Return a column of links to files beside the page."""

    def cell(row: Row) -> Cell:
        return Cell("open" if row[name] else "", row[name] or None, row[name] or "")

    return Column(heading, cell)


SHOWN: dict[str, tuple[Column, ...]] = {
    "verify": (
        text("decision", "decision"),
        text("start (UTC)", "start_utc", whole=True),
        figure("into the reference (s)", "lag_s", "lag_std_s"),
        text("grid", "grid"),
        figure("log10 LR, other times", "log10_lr"),
        figure("log10 LR, elsewhere", "log10_lr_absent"),
        text("in words", "verbal"),
        text("claim", "claim"),
        figure("camera's clock (ppm)", "clock_ppm", "clock_std_ppm"),
        figure("usable (s)", "seconds_used"),
    ),
    "idle": (
        text("verdict", "verdict"),
        figure("idle (%)", "idle_ratio", "idle_ratio_std", 100.0),
        between("95 % interval (%)", "idle_ratio_low", "idle_ratio_high", 100.0, 3),
        figure("read-out (ms)", "read_out_time_s", "read_out_time_std_s", 1e3),
        text("direction", "direction"),
        figure("frames/s", "frame_rate_hz"),
        figure("grid (Hz)", "nominal_hz"),
    ),
    "track": (
        share("usable values", "usable_values", "values"),
        figure("mean ENF (Hz)", "enf_mean_hz", "enf_mean_std_hz"),
        between("from, to (Hz)", "enf_min_hz", "enf_max_hz", 1.0, 4),
        figure("error of one (mHz)", "enf_std_median_hz", "", 1e3),
        figure("SNR (dB)", "snr_median_db"),
        figure("line (Hz)", "line_hz"),
        figure("frames/s", "frame_rate_hz"),
        file("values", "enf_file"),
    ),
    "discover": (
        text("verdict", "verdict"),
        text("effects", "effects"),
        small("gap before", "gap_before", "gap_before_stderr"),
        small("gap after", "gap_after", "gap_stderr"),
        small("of the model's own data, at most", "gap_limit"),
        text("unexplained", "unexplained"),
        file("report", "report"),
    ),
}


_HERE = Path(__file__).parent
_TONES = {"done": "match", "no_signal": "no_decision", "unusable": "no_match", "failed": "no_match"}


def batch_page(analysis: str, rows: Sequence[Mapping[str, Any]], settings: dict[str, str]) -> str:
    """Return the page of a batch as HTML.

    Parameters
    ----------
    analysis : str
        The verb: a key of ``SHOWN``.
    rows : sequence of mapping
        Rows with all columns of the result table.
    settings : dict of str
        Settings of the analysis, as text.
    """
    folder = _common_folder([row["path"] for row in rows])
    columns = [
        Column("recording", lambda row: _path(row, folder)),
        Column("status", _status, badge=True),
        *SHOWN[analysis],
        figure("recording (s)", "recording_s"),
        Column("remarks", _remarks),
    ]
    script = (_HERE / "sort.js").read_text(encoding="utf-8")
    return fill(
        _HERE / "page.html.j2",
        [],
        analysis=analysis,
        folder=folder,
        counts=Counter(row["status"].replace("_", " ") for row in rows).most_common(),
        total=len(rows),
        columns=columns,
        lines=[
            (_TONES[row["status"]], [(column, column.cell(row)) for column in columns])
            for row in rows
        ],
        settings=settings,
        versions=sorted({str(row["rsenf_version"] or "") for row in rows} - {""}),
        script=script,
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _common_folder(paths: Sequence[str]) -> str:
    """Return the deepest folder that contains all paths."""
    return os.path.commonpath([os.path.dirname(path) for path in paths])


def _path(row: Mapping[str, Any], folder: str) -> Cell:
    shown = os.path.relpath(row["path"], folder)
    return Cell(shown, shown)


def _status(row: Mapping[str, Any]) -> Cell:
    return Cell(row["status"].replace("_", " "), row["status"])


def _remarks(row: Mapping[str, Any]) -> Cell:
    """Return reason, loss and warnings of a row."""
    text = "; ".join(filter(None, [row["reason"], row["loss"], *(row["warnings"] or [])]))
    return Cell(text, text or None)
