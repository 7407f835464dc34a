"""Finds the recordings in files, folders and lists; each once, whatever its names."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from rsenf.errors import UsageError

JOURNAL = "batch.jsonl"  # a folder with one holds results, not recordings
# Extensions of recordings in folders.
# fmt: off
ENDINGS = {
    ".264", ".265", ".3gp", ".asf", ".avi", ".dav", ".flv", ".h264",
    ".h265", ".hevc", ".ivf", ".m2ts", ".m4v", ".mcap", ".mjpeg", ".mjpg",
    ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".mxf", ".npz",
    ".ogv", ".qt", ".ts", ".vob", ".webm", ".wmv", ".y4m",
}
# fmt: on


@dataclass(frozen=True)
class Recording:
    """A file, with size and time to detect changes.

    Parameters
    ----------
    path : str
        Absolute, as it was found.
    key : str
        Absolute, with links resolved.
    size_bytes, modified_ns : int
        -1 if there is no such file.
    """

    path: str
    key: str
    size_bytes: int
    modified_ns: int


@dataclass
class Found:
    """Result of a search.

    Attributes
    ----------
    recordings : list of Recording
        In the order of the arguments, sorted by name within a folder.
    passed_over : Counter of str
        Number of files that don't look like recordings, by extension.
    again : int
        Number of duplicates: other names of a recording.
    unreadable : list of str
        Folders, each with the reason.
    """

    recordings: list[Recording] = field(default_factory=list)
    passed_over: Counter[str] = field(default_factory=Counter)
    again: int = 0
    unreadable: list[str] = field(default_factory=list)


def recording_of(path: str | os.PathLike[str]) -> Recording:
    """Return a recording in its present state."""
    name = os.path.abspath(path)
    try:
        there = os.stat(name)
    except OSError:
        return Recording(name, os.path.realpath(name), -1, -1)
    return Recording(name, os.path.realpath(name), there.st_size, there.st_mtime_ns)


def find_recordings(paths: Iterable[str], out: Path) -> Found:
    """Find recordings in files and folders, recursively.

    In folders, files are selected by extension; hidden files and folders are skipped, and so are
    results: ``out``, and any folder with a journal. Files that are named are always taken.

    Parameters
    ----------
    paths : iterable of str
    out : Path
        Folder of the results.
    """
    found, seen = Found(), set[str]()
    for path in paths:
        files = _files_in(path, os.path.realpath(out), found) if os.path.isdir(path) else [path]
        for file in files:
            recording = recording_of(file)
            if recording.key in seen:
                found.again += 1
            else:
                seen.add(recording.key)
                found.recordings.append(recording)
    return found


def _files_in(folder: str, out: str, found: Found) -> Iterator[str]:
    """Yield files with the extension of a recording, count the others."""

    def unreadable(error: OSError) -> None:
        found.unreadable.append(f"{error.filename}: {error.strerror}")

    entered: set[str] = set()
    for where, folders, files in os.walk(folder, onerror=unreadable, followlinks=True):
        real = os.path.realpath(where)
        if real in entered or real == out or JOURNAL in files:
            folders.clear()  # a link to a folder visited already, or results
            continue
        entered.add(real)
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            ending = os.path.splitext(name)[1].lower()
            if name.startswith(".") or ending not in ENDINGS:
                found.passed_over[ending or "no ending"] += 1
            else:
                yield os.path.join(where, name)


def read_list(data: bytes, name: str) -> list[str]:
    """Return the paths of a list: one a line, or separated by NUL as by ``find -print0``.

    Raises
    ------
    UsageError
        If it isn't a list of paths, or none of them exists.
    """
    parts = data.split(b"\0") if b"\0" in data else data.splitlines()
    lines = [part for part in parts if part.strip()]
    longest = max((len(name) for line in lines for name in line.split(b"/")), default=0)
    if not lines or longest > os.pathconf("/", "PC_NAME_MAX"):
        raise UsageError(f"{name}: not a list of recordings", "one path a line")
    paths = [os.fsdecode(line) for line in lines]
    if not any(map(os.path.lexists, paths)):
        raise UsageError(
            f"{name}: nothing of what it lists is there, such as {paths[0]!r}",
            "relative paths are taken from the folder that you are in",
        )
    return paths
