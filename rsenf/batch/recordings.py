"""The recordings meant by files, folders and lists: each once, whatever it is called."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from rsenf.errors import UsageError

JOURNAL = "batch.jsonl"  # a folder with one holds results, not recordings
# Endings by which recordings are told from all else that lies in folders.
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
    """A file, and by what to see that it is still the same.

    Parameters
    ----------
    path : str
        Absolute, as it was found.
    key : str
        Absolute, links followed.
    size_bytes, modified_ns : int
        -1 where there is no such file.
    """

    path: str
    key: str
    size_bytes: int
    modified_ns: int


@dataclass
class Found:
    """What a search has come to.

    Attributes
    ----------
    recordings : list of Recording
        In the order of what was named, by name within a folder.
    passed_over : Counter of str
        Files that don't look like recordings, by their endings.
    again : int
        Names of recordings that had been found under another.
    unreadable : list of str
        Folders, each with the reason.
    """

    recordings: list[Recording] = field(default_factory=list)
    passed_over: Counter[str] = field(default_factory=Counter)
    again: int = 0
    unreadable: list[str] = field(default_factory=list)


def recording_of(path: str | os.PathLike[str]) -> Recording:
    """Return a recording as it is now."""
    name = os.path.abspath(path)
    try:
        there = os.stat(name)
    except OSError:
        return Recording(name, os.path.realpath(name), -1, -1)
    return Recording(name, os.path.realpath(name), there.st_size, there.st_mtime_ns)


def find_recordings(paths: Iterable[str], out: Path) -> Found:
    """Look for recordings in files and folders, and the folders in those.

    In folders only what is called like a recording is one, hidden files and folders are passed by,
    and so are results: ``out``, and whatever has a journal. What is named itself is always taken.

    Parameters
    ----------
    paths : iterable of str
    out : Path
        Where results go.
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
    """Yield what is called like a recording, count the rest."""

    def unreadable(error: OSError) -> None:
        found.unreadable.append(f"{error.filename}: {error.strerror}")

    entered: set[str] = set()
    for where, folders, files in os.walk(folder, onerror=unreadable, followlinks=True):
        real = os.path.realpath(where)
        if real in entered or real == out or JOURNAL in files:
            folders.clear()  # a link to where we have been, or results
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
    """Return the paths of a list: one a line, or ended by NUL as ``find -print0`` does.

    Raises
    ------
    UsageError
        When it isn't a list of paths, or nothing is there of what it lists.
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
