"""Decides from the journal what is left to do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from rsenf.batch.columns import DONE, NO_SIGNAL, UNUSABLE, VERSION, Row
from rsenf.batch.recordings import Recording
from rsenf.errors import UsageError

NEW, CHANGED, OTHER, TRIED = "new", "changed since", "done with other settings", "without a result"


def check_analysis(analysis: str, rows: Iterable[Row], out: Path) -> None:
    """Refuse to replace the results of another analysis.

    Raises
    ------
    UsageError
        If there are any.
    """
    others = {str(row.get("analysis")) for row in rows} - {analysis}
    if others:
        problem = f"--out {out}: holds results of '{min(others)}'"
        raise UsageError(problem, f"name another folder for those of '{analysis}'")


def left_to_do(
    recordings: Iterable[Recording], rows: Mapping[str, Row], settings: str, *, retry: bool
) -> tuple[list[Recording], Counter[str]]:
    """Return the recordings to do, and their number by reason.

    A recording that was read completely and is unusable is skipped until it changes; one that could
    not be read, or failed, is tried again.

    Parameters
    ----------
    recordings : iterable of Recording
    rows : mapping of dict
        Rows of the journal, by the key of the recording.
    settings : str
        Fingerprint of everything else that results depend on.
    retry : bool
        Whether to do unusable recordings again, too.
    """
    pending, reasons = [], Counter[str]()
    for recording in recordings:
        reason = _why(recording, rows.get(recording.key), settings, retry)
        if reason:
            pending.append(recording)
            reasons[reason] += 1
    return pending, reasons


def _why(recording: Recording, row: Row | None, settings: str, retry: bool) -> str:
    """Return the reason to do a recording; empty if it is done."""
    if row is None:
        return NEW
    if (row.get("version"), row.get("settings")) != (VERSION, settings):
        return OTHER
    if (row["size_bytes"], row["modified_ns"]) != (recording.size_bytes, recording.modified_ns):
        return CHANGED
    settled = row["status"] in (DONE, NO_SIGNAL) or (is_useless(row) and not retry)
    return "" if settled else TRIED


def is_useless(row: Row) -> bool:
    """Whether a recording was read completely and is unusable."""
    return row["status"] == UNUSABLE and row["sha256"] is not None
