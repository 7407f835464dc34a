"""The page: counts, the table, the settings. It needs nothing else, and sorts by its headings."""

from __future__ import annotations

import base64
import hashlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rsenf.report.batch_page.cells import SHOWN, Cell, Column, figure
from rsenf.report.pages import fill

_HERE = Path(__file__).parent
_TONES = {"done": "match", "no_signal": "no_decision", "unusable": "no_match", "failed": "no_match"}


def batch_page(analysis: str, rows: Sequence[Mapping[str, Any]], settings: dict[str, str]) -> str:
    """Return the page.

    Parameters
    ----------
    analysis : str
    rows : sequence of mapping
        With all columns of the table.
    settings : dict of str
        How the recordings were treated, as told to people.
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
    """Return the folder that all paths are in."""
    return os.path.commonpath([os.path.dirname(path) for path in paths])


def _path(row: Mapping[str, Any], folder: str) -> Cell:
    shown = os.path.relpath(row["path"], folder)
    return Cell(shown, shown)


def _status(row: Mapping[str, Any]) -> Cell:
    return Cell(row["status"].replace("_", " "), row["status"])


def _remarks(row: Mapping[str, Any]) -> Cell:
    """Why there is no result, what is lost, what to mind."""
    told = "; ".join(filter(None, [row["reason"], row["loss"], *(row["warnings"] or [])]))
    return Cell(told, told or None)
