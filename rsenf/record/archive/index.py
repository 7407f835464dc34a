"""Summaries of all files of an archive, small enough to be cached for thousands in one index."""

from __future__ import annotations

import contextlib
import json
import os
import zlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.errors import InputError, RecordingError, UsageError
from rsenf.messages import schema_name
from rsenf.record.archive.layout import ArchivedFile, archived_files
from rsenf.record.container import check_magic
from rsenf.record.examine import RECOVERED
from rsenf.record.growing import CLOSING
from rsenf.record.index import Stretch, at_most, span_of, usual_interval_ns
from rsenf.record.reader import open_file
from rsenf.record.sequence import OF_ALL_SO_FAR, MessagePlace, count_of
from rsenf.record.summary import read_contents
from rsenf.record.topics import Topic, topics_of
from rsenf.timebase import NS_PER_S
from rsenf.whole_file import whole_file

COMPLETE, TRUNCATED, UNREADABLE = "complete", "truncated", "unreadable"
# A gap is a pause of at least this multiple of the usual interval, and this length.
UNUSUAL, SHORTEST_GAP_NS = 5, 2 * NS_PER_S
TOO_FEW = 10  # with fewer messages the usual interval is unknown
MOST_STRETCHES = 64  # for each topic in a file
_OF_ALL_SO_FAR = frozenset(map(schema_name, OF_ALL_SO_FAR))
VERSION = 3
NAME = "index.json"


@dataclass(frozen=True)
class TopicSummary:
    """A topic in a file."""

    messages: int
    # messages that never arrived; None if unknown, as in a truncated or damaged file
    missed: int | None
    # places of the first and the last message, in the format of
    # :class:`rsenf.record.sequence.MessagePlace`; empty if unknown
    first: str
    last: str
    # times with messages, including pauses that are usual for this topic
    stretches: tuple[Stretch, ...]
    coarse_ns: int = 0  # if there were too many stretches: the longest gap omitted. Otherwise 0
    # whether each message refers to its whole stream so far. Its log time is then the beginning of
    # the stream
    of_all_so_far: bool = False

    @property
    def extent(self) -> Stretch:
        """Time from the first message to the last."""
        return Stretch(self.stretches[0].first_ns, self.stretches[-1].last_ns)


@dataclass(frozen=True)
class FileSummary:
    """A file."""

    size_bytes: int  # size and time of the last change; if either differs, the summary is outdated
    changed_ns: int
    state: str  # one of COMPLETE, TRUNCATED and UNREADABLE
    cut_bytes: int = 0  # bytes after the last complete record; number of damaged records
    damaged: int = 0
    # whether the file was read completely; otherwise its summary section was trusted
    checked: bool = True
    recovered: bool = False  # whether it was recovered from a damaged file
    topics: dict[str, TopicSummary] = field(default_factory=dict)

    @property
    def extent(self) -> Stretch | None:
        """Time from its first message to its last; None without any."""
        topics = self.topics.values()
        extents = [t.extent for t in topics if not t.of_all_so_far]
        return span_of(extents or [t.extent for t in topics])

    @classmethod
    def from_json(cls, entry: dict[str, Any]) -> FileSummary:
        """Read a summary from JSON data, as written by ``dataclasses.asdict``.

        Raises
        ------
        TypeError, KeyError, ValueError, AttributeError
            When the data is invalid.
        """
        topics = {
            name: TopicSummary(
                **{**topic, "stretches": tuple(Stretch(*s) for s in topic["stretches"])}
            )
            for name, topic in entry["topics"].items()
        }
        return cls(**{**entry, "topics": topics})


def pause_ns(stretches: Iterable[Stretch], messages: int) -> int:
    """Return the longest pause between messages that is no gap, from their usual interval."""
    return max(SHORTEST_GAP_NS, UNUSUAL * usual_interval_ns(stretches, messages))


def summarise(path: Path, *, check: bool = False) -> FileSummary:
    """Summarise a file.

    Parameters
    ----------
    path : Path
    check : bool
        Whether to read the file completely, to detect damage; otherwise only if its summary section
        is missing or invalid.

    Raises
    ------
    OSError
        When it no longer exists.
    """
    found = os.stat(path)
    size, changed = found.st_size, found.st_mtime_ns
    try:
        with open_file(path) as stream:
            check_magic(path, stream)
            contents = read_contents(stream, size, (lambda found: None) if check else None)
    except (InputError, UsageError):
        return FileSummary(size, changed, UNREADABLE)
    recovered, topics = RECOVERED in contents.metadata, topics_of(contents.index)
    closing = contents.metadata.get(CLOSING, {})
    if recovered or contents.damages:
        closing = {}  # its closing notes describe the original file
    return FileSummary(
        size,
        changed,
        COMPLETE if contents.complete else TRUNCATED,
        contents.cut_bytes,
        len(contents.damages),
        check or not contents.complete,
        recovered,
        {name: _topic(topic, closing) for name, topic in topics.items()},
    )


def _topic(topic: Topic, closing: dict[str, str]) -> TopicSummary:
    usual_ns = pause_ns(topic.stretches, topic.messages) if topic.messages >= TOO_FEW else 0
    stretches, hole_ns = at_most(topic.stretches, usual_ns, MOST_STRETCHES)
    return TopicSummary(
        topic.messages,
        count_of(closing.get(f"missed {topic.name}")),
        _place(closing.get(f"first {topic.name}", "")),
        _place(closing.get(f"last {topic.name}", "")),
        tuple(stretches),
        hole_ns if hole_ns > usual_ns else 0,
        topic.schema in _OF_ALL_SO_FAR,
    )


def _place(text: str) -> str:
    """Return the text of a place; empty if it is invalid."""
    try:
        return str(MessagePlace.read(text))
    except ValueError:
        return ""


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
            files = {name: asdict(summary) for name, summary in found.items()}
            with whole_file(root / NAME) as part:
                index = {"version": VERSION, "crc32": _crc32(files), "files": files}
                part.write_text(json.dumps(index), encoding="utf-8")
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
    """Return the summaries in the index; none if it is of another version or damaged."""
    try:
        index = json.loads((root / NAME).read_bytes())
        if index["version"] != VERSION or index["crc32"] != _crc32(index["files"]):
            return {}
        return {name: FileSummary.from_json(entry) for name, entry in index["files"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def _crc32(files: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(files).encode())
