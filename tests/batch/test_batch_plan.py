"""What is done again by the next run of a batch, and what isn't."""

from __future__ import annotations

import pytest

from rsenf.batch.columns import (
    CHANGED,
    DAMAGED,
    DONE,
    FAILED,
    NEW,
    NO_SIGNAL,
    OTHER,
    TRIED,
    UNUSABLE,
    VERSION,
    Row,
    left_to_do,
)
from rsenf.batch.settings import RecordingFile


def why(row: Row | None, *, retry: bool = False) -> str:
    """Why a recording is done, given its row in the journal."""
    recording = RecordingFile("/a.mp4", "/a.mp4", size_bytes=5, modified_ns=7)
    rows = {} if row is None else {"/a.mp4": row}
    left, reasons = left_to_do([recording], rows, "as now", retry=retry)
    assert len(left) == reasons.total()
    return next(iter(reasons), "")


def row(status: str, **more: object) -> Row:
    same = {"version": VERSION, "settings": "as now", "size_bytes": 5, "modified_ns": 7}
    return same | {"analysis": "verify", "path": "/a.mp4", "status": status, "sha256": "1f"} | more


@pytest.mark.parametrize(
    ("found", "at_once", "on_retry"),
    [
        (None, NEW, NEW),
        (row(DONE), "", ""),
        (row(NO_SIGNAL), "", ""),
        (row(DONE, settings="as before"), OTHER, OTHER),
        (row(UNUSABLE, size_bytes=6), CHANGED, CHANGED),
        (row(FAILED), TRIED, TRIED),
        (row(UNUSABLE), "", TRIED),
        (row(UNUSABLE, sha256=None), TRIED, TRIED),  # it couldn't be read
        (row("finished"), DAMAGED, DAMAGED),
        (row(DONE, path=None), DAMAGED, DAMAGED),
        (row(DONE, lag_s="late"), DAMAGED, DAMAGED),
        (row(DONE, search_size=2**63), DAMAGED, DAMAGED),
        (row(DONE, warnings=[1]), DAMAGED, DAMAGED),
    ],
)
def test_what_is_of_no_use_is_not_done_again(
    found: Row | None, at_once: str, on_retry: str
) -> None:
    assert why(found) == at_once
    assert why(found, retry=True) == on_retry
