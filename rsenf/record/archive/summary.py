"""What one file of an archive holds, in few enough words to be kept for thousands of files."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rsenf.errors import InputError, UsageError
from rsenf.messages import schema_name
from rsenf.record.container import check_magic
from rsenf.record.examine import RECOVERED
from rsenf.record.growing import CLOSING
from rsenf.record.reader import open_file
from rsenf.record.stretches import Stretch, at_most, usual_interval_ns
from rsenf.record.summary import read_contents
from rsenf.record.tally import Place, count_of
from rsenf.record.timeline import OF_ALL_SO_FAR
from rsenf.record.topics import Topic, topics_of
from rsenf.timebase import NS_PER_S

COMPLETE, TRUNCATED, UNREADABLE = "complete", "truncated", "unreadable"
# A pause this many times as long as is usual between two messages is a gap, if it isn't short.
UNUSUAL, SHORTEST_GAP_NS = 5, 2 * NS_PER_S
TOO_FEW = 10  # messages to tell what is usual
MOST_STRETCHES = 64  # of a topic in a file
_OF_ALL_SO_FAR = frozenset(map(schema_name, OF_ALL_SO_FAR))


@dataclass(frozen=True)
class TopicSummary:
    """A topic in a file.

    Attributes
    ----------
    messages : int
    missed : int or None
        Messages that never came; None for a file that broke off or is damaged, which can't tell.
    first, last : str
        Place of the first and the last message, as :class:`rsenf.record.tally.Place` reads it;
        empty where the file doesn't tell.
    stretches : tuple of Stretch
        When there were messages, pauses that are none for this topic included.
    coarse_ns : int
        Where there were too many to keep: the longest gap that they don't show. Else 0.
    of_all_so_far : bool
        Whether its messages are of their stream from its beginning on, and lie there on the time
        line, however late they came.
    """

    messages: int
    missed: int | None
    first: str
    last: str
    stretches: tuple[Stretch, ...]
    coarse_ns: int = 0
    of_all_so_far: bool = False

    @property
    def extent(self) -> Stretch:
        """From the first message to the last."""
        return Stretch(self.stretches[0].first_ns, self.stretches[-1].last_ns)


@dataclass(frozen=True)
class FileSummary:
    """A file.

    Attributes
    ----------
    size_bytes, changed_ns : int
        Size, and when it was last written; where these differ, the file is another one.
    state : {'complete', 'truncated', 'unreadable'}
        Whether it has its end, or what can be read of it.
    cut_bytes, damaged : int
        Bytes after the last whole record; records that aren't what was written.
    checked : bool
        Whether all of it was read; else its end was believed.
    recovered : bool
        Whether it is what was left of a damaged one.
    topics : dict of str to TopicSummary
    """

    size_bytes: int
    changed_ns: int
    state: str
    cut_bytes: int = 0
    damaged: int = 0
    checked: bool = True
    recovered: bool = False
    topics: dict[str, TopicSummary] = field(default_factory=dict)

    @property
    def extent(self) -> Stretch | None:
        """From its first message to its last; None for a file without any."""
        topics = self.topics.values()
        extents = [t.extent for t in topics if not t.of_all_so_far] or [t.extent for t in topics]
        if not extents:
            return None
        return Stretch(min(e.first_ns for e in extents), max(e.last_ns for e in extents))

    def to_json(self) -> dict[str, Any]:
        """Return what :meth:`from_json` reads."""
        return asdict(self)

    @classmethod
    def from_json(cls, entry: dict[str, Any]) -> FileSummary:
        """Read a summary.

        Raises
        ------
        TypeError, KeyError, ValueError, AttributeError
            When it is none.
        """
        topics = {
            name: TopicSummary(
                **{**topic, "stretches": tuple(Stretch(*s) for s in topic["stretches"])}
            )
            for name, topic in entry["topics"].items()
        }
        return cls(**{**entry, "topics": topics})


def pause_ns(stretches: Iterable[Stretch], messages: int) -> int:
    """Longest pause between two messages that is no gap, by how often they come."""
    return max(SHORTEST_GAP_NS, UNUSUAL * usual_interval_ns(stretches, messages))


def summarise(path: Path, *, check: bool = False) -> FileSummary:
    """Find out what a file holds.

    Parameters
    ----------
    path : Path
    check : bool
        Whether to read all of it, so that damage shows; else that is done only where it has no
        sound end.

    Raises
    ------
    OSError
        When it isn't there any more.
    """
    found = os.stat(path)
    size, changed = found.st_size, found.st_mtime_ns
    try:
        with open_file(path) as stream:
            check_magic(path, stream)
            contents = read_contents(stream, size, _unwatched if check else None)
    except (InputError, UsageError):
        return FileSummary(size, changed, UNREADABLE)
    recovered, topics = RECOVERED in contents.metadata, topics_of(contents.index)
    told = contents.metadata.get(CLOSING, {})
    if recovered or contents.damages:
        told = {}  # what it says of itself was true before
    return FileSummary(
        size,
        changed,
        COMPLETE if contents.complete else TRUNCATED,
        0 if contents.complete else size - contents.end,
        len(contents.damages),
        check or not contents.complete,
        recovered,
        {name: _topic(topic, told) for name, topic in topics.items()},
    )


def _unwatched(_: object) -> None:
    """Have all of a file read, and look at none of it."""


def _topic(topic: Topic, told: dict[str, str]) -> TopicSummary:
    usual_ns = pause_ns(topic.stretches, topic.messages) if topic.messages >= TOO_FEW else 0
    stretches, hole_ns = at_most(topic.stretches, usual_ns, MOST_STRETCHES)
    return TopicSummary(
        topic.messages,
        count_of(told.get(f"missed {topic.name}")),
        _place(told.get(f"first {topic.name}", "")),
        _place(told.get(f"last {topic.name}", "")),
        tuple(stretches),
        hole_ns if hole_ns > usual_ns else 0,
        topic.schema in _OF_ALL_SO_FAR,
    )


def _place(text: str) -> str:
    """Return the text of a place; none where it is no longer one."""
    try:
        return str(Place.read(text))
    except ValueError:
        return ""
