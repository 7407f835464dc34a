"""Summaries of all files of an archive, cached in an index file."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import NamedTuple

from rsenf.errors import RecordingError, UsageError
from rsenf.record.archive.layout import ArchivedFile, archived_files
from rsenf.record.archive.summary import FileSummary, summarise
from rsenf.whole_file import whole_file

VERSION = 2
NAME = "index.json"


class Entry(NamedTuple):
    """A file and its summary."""

    file: ArchivedFile
    summary: FileSummary


def read_archive(root: Path, *, check: bool = False) -> list[Entry]:
    """Summarise all files of an archive, oldest first.

    Summaries of unchanged files come from ``index.json`` in the archive, and new ones are written
    there. A read-only archive works too.

    Parameters
    ----------
    root : Path
        Folder of the archive.
    check : bool
        Whether to read each file completely, once; otherwise the summary section of a file that
        seems complete is trusted.

    Raises
    ------
    UsageError
        When there is no such folder.
    """
    if not root.is_dir():
        raise UsageError(f"{root}: no such folder", "name the folder of an archive")
    known, entries = _known(root), []
    for file in archived_files(root):
        with contextlib.suppress(FileNotFoundError):  # deleted meanwhile
            entries.append(Entry(file, _summary(file.path, known.get(_name(root, file)), check)))
    found = {_name(root, entry.file): entry.summary for entry in entries}
    if found != known:
        with contextlib.suppress(RecordingError):
            _write(root, found)
    return entries


def _summary(path: Path, known: FileSummary | None, check: bool) -> FileSummary:
    found = path.stat()
    same = known and (known.size_bytes, known.changed_ns) == (found.st_size, found.st_mtime_ns)
    if known and same and (known.checked or not check):
        return known
    return summarise(path, check=check)


def _name(root: Path, file: ArchivedFile) -> str:
    return file.path.relative_to(root).as_posix()


def _known(root: Path) -> dict[str, FileSummary]:
    """Return the summaries in the index; none if it is of another version or invalid."""
    try:
        index = json.loads((root / NAME).read_bytes())
        if index["version"] != VERSION:
            return {}
        return {name: FileSummary.from_json(entry) for name, entry in index["files"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _write(root: Path, found: dict[str, FileSummary]) -> None:
    files = {name: summary.to_json() for name, summary in found.items()}
    with whole_file(root / NAME) as part:
        part.write_text(json.dumps({"version": VERSION, "files": files}), encoding="utf-8")
