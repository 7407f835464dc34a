"""What one file of an archive holds, in few enough words to be kept for thousands of files."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rsenf.errors import InputError, UsageError
from rsenf.record.growing import CLOSING
from rsenf.record.reader import open_recording
from rsenf.record.stretches import Stretch
from rsenf.record.topics import Topic

COMPLETE, TRUNCATED, UNREADABLE = "complete", "truncated", "unreadable"


@dataclass(frozen=True)
class TopicSummary:
    """A topic in a file.

    Attributes
    ----------
    messages : int
    missed : int or None
        Messages that never came; None for a file that broke off, which can't tell.
    first, last : str
        Place of the first and the last message, as :class:`rsenf.record.tally.Place` reads it;
        empty where the file doesn't tell.
    stretches : tuple of Stretch
        When there were messages.
    """

    messages: int
    missed: int | None
    first: str
    last: str
    stretches: tuple[Stretch, ...]


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
    topics : dict of str to TopicSummary
    """

    size_bytes: int
    changed_ns: int
    state: str
    cut_bytes: int = 0
    damaged: int = 0
    topics: dict[str, TopicSummary] = field(default_factory=dict)

    @property
    def extent(self) -> Stretch | None:
        """From its first message to its last; None for a file without any."""
        stretches = [s for topic in self.topics.values() for s in topic.stretches]
        if not stretches:
            return None
        return Stretch(min(s.first_ns for s in stretches), max(s.last_ns for s in stretches))

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


def summarise(path: Path) -> FileSummary:
    """Find out what a file holds; all of it is read only where it has no sound end.

    Raises
    ------
    OSError
        When it isn't there any more.
    """
    found = os.stat(path)
    size, changed = found.st_size, found.st_mtime_ns
    try:
        recording = open_recording(path)
    except (InputError, UsageError):
        return FileSummary(size, changed, UNREADABLE)
    closing = recording.metadata.get(CLOSING, {})
    return FileSummary(
        size,
        changed,
        COMPLETE if recording.complete else TRUNCATED,
        recording.loss.cut_bytes,
        recording.loss.damaged,
        {name: _topic(topic, closing) for name, topic in recording.topics.items()},
    )


def _topic(topic: Topic, closing: dict[str, str]) -> TopicSummary:
    missed = closing.get(f"missed {topic.name}")
    return TopicSummary(
        topic.messages,
        None if missed is None else int(missed),
        closing.get(f"first {topic.name}", ""),
        closing.get(f"last {topic.name}", ""),
        topic.stretches,
    )
