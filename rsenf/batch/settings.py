"""What a batch is to do: its recordings, and its settings with their fingerprint.

Recordings are found in files, folders and lists; each once, whatever its names. Settings are
checked before any long work.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rsenf import __version__
from rsenf.api.discover import discover_start
from rsenf.api.idle import idle_settings
from rsenf.api.shared import changed, open_references, track_settings
from rsenf.api.verify import check_verify
from rsenf.errors import UsageError
from rsenf.model import load_effects
from rsenf.reference import Reference
from rsenf.reference.open import STORE, utc_ns

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
class RecordingFile:
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
    recordings : list of RecordingFile
        In the order of the arguments, sorted by name within a folder.
    passed_over : Counter of str
        Number of files that don't look like recordings, by extension.
    again : int
        Number of duplicates: other names of a recording.
    unreadable : list of str
        Folders, each with the reason.
    """

    recordings: list[RecordingFile] = field(default_factory=list)
    passed_over: Counter[str] = field(default_factory=Counter)
    again: int = 0
    unreadable: list[str] = field(default_factory=list)


def recording_of(path: str | os.PathLike[str]) -> RecordingFile:
    """Return a recording in its present state."""
    name = os.path.abspath(path)
    try:
        there = os.stat(name)
    except OSError:
        return RecordingFile(name, os.path.realpath(name), -1, -1)
    return RecordingFile(name, os.path.realpath(name), there.st_size, there.st_mtime_ns)


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


@dataclass(frozen=True)
class Settings:
    """The settings for every recording of a batch.

    Parameters
    ----------
    analysis : str
        Name of one of the functions of :mod:`rsenf`.
    options : mapping
        Its arguments, except for the recording and the reference.
    references : tuple of str
        Files, or ``store:GRID``. All paths are absolute once checked.
    reading : mapping
        Arguments of :func:`rsenf.api.shared.open_references`.
    effects : tuple of Path
        Files of effects to add to the catalogue.
    begin : str
        Topic of an ``.mcap`` recording to start from.
    camera : str
        Camera of a recording with several.
    frame_rate_hz : float, optional
        Frame rate to use instead of missing or wrong frame times.
    effort : {'full', 'fast', 'auto'}
        How videos are decoded.
    out : str
        Folder of the batch.
    threads : int
        Threads that decode a video.
    fingerprint : str
        Hash of everything that results depend on, apart from the recordings.
    version : str
        Of rsenf.
    """

    analysis: str
    options: Mapping[str, Any] = field(compare=False)
    references: tuple[str, ...] = ()
    reading: Mapping[str, Any] = field(default_factory=dict, compare=False)
    effects: tuple[Path, ...] = ()
    begin: str = "rows"
    camera: str = ""
    frame_rate_hz: float | None = None
    effort: Literal["full", "fast", "auto"] = "auto"
    out: str = "."
    threads: int = 0
    fingerprint: str = ""
    version: str = __version__

    def displayed(self) -> dict[str, Any]:
        """Return the settings that aren't the default, for display."""
        given: dict[str, Any] = {"reference": list(self.references), "effects": list(self.effects)}
        given |= {"begin": self.begin, "camera": self.camera}
        given |= {"frame_rate_hz": self.frame_rate_hz, **self.reading}
        given |= {"effort": self.effort} if self.effort != "auto" else {}
        for name, value in self.options.items():
            is_stage = dataclasses.is_dataclass(value)
            given |= changed(value, type(value)()) if is_stage else {name: value}
        return {name: value for name, value in given.items() if value not in (None, "", False, [])}


def checked(settings: Settings) -> Settings:
    """Return settings with absolute paths and their fingerprint.

    Raises
    ------
    UsageError
        If a setting is invalid, once here instead of for every recording.
    """
    given, named = settings.options.items(), settings.references
    options = {name: v.absolute() if isinstance(v, Path) else v for name, v in given}
    reading = {name: value for name, value in settings.reading.items() if value is not None}
    if "store" in reading:
        reading["store"] = os.path.abspath(reading["store"])
    settings = dataclasses.replace(
        settings,
        options=options,
        references=tuple(s if s.startswith(STORE) else os.path.abspath(s) for s in named),
        reading=reading,
        effects=tuple(path.absolute() for path in settings.effects),
        out=os.path.abspath(settings.out),
    )
    _check(settings)
    references = open_references(settings.references, **reading) if settings.references else []
    identity = {name: _plain(value) for name, value in options.items()} | {
        "reference": [_content(reference) for reference in references],
        "reading": {name: value for name, value in reading.items() if name != "store"},
        "effects": [_plain(path) for path in settings.effects],
        "begin": [settings.begin, settings.camera, settings.frame_rate_hz, settings.effort],
    }
    text = json.dumps([settings.analysis, __version__, identity], sort_keys=True)
    fingerprint = hashlib.sha256(text.encode()).hexdigest()[:16]
    return dataclasses.replace(settings, fingerprint=fingerprint)


def _check(settings: Settings) -> None:
    """Refuse settings that would be wrong for every recording."""
    options = settings.options
    if settings.analysis == "track":
        track_settings(options.get("settings"))
    elif settings.analysis == "idle":
        idle_settings(options["settings"])
    elif settings.analysis == "verify":
        if options.get("start"):
            utc_ns(options["start"], "start")
        check_verify(options["method"], options.get("track"))
    else:
        for path in settings.effects:
            load_effects(path)
        discover_start(options.get("model"), options.get("fits"), None)


def _plain(value: Any) -> Any:
    """Return a setting as plain values; for a file, the hash of its content."""
    if isinstance(value, Path):
        return hashlib.sha256(value.read_bytes()).hexdigest()
    return dataclasses.asdict(value) if dataclasses.is_dataclass(value) else value  # type: ignore[arg-type]  # of an instance


def _content(reference: Reference) -> Sequence[Any]:
    """Return what identifies the content of a reference, which changes with an import."""
    span = (reference.t0_ns, reference.step_s, int(reference.freq_hz.size))
    return (reference.grid, reference.nominal_hz, reference.sha256, *span)
