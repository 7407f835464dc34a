"""Examines a recording: its contents, missing messages, and damage of the file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode

from rsenf.errors import SchemaMismatch
from rsenf.record.channels import COMPANION, VERSION
from rsenf.record.container import DamagedError, check_magic
from rsenf.record.decoder import Decoder
from rsenf.record.gaps import Gap, TopicNumbers
from rsenf.record.growing import ABOUT, CLOSING
from rsenf.record.intact_records import Damage, IntactRecords
from rsenf.record.reader import open_file
from rsenf.record.scan import Contents
from rsenf.record.summary import read_contents
from rsenf.record.tally import count_of
from rsenf.record.topics import Topic, topics_of
from rsenf.record.write_lock import is_held

RECOVERED = "rsenf.recovered"


class TopicState(NamedTuple):
    """One topic of a recording.

    Attributes
    ----------
    topic : Topic
    version : str
        Version of its schema; empty for foreign schemas.
    gaps : list of Gap
    duplicates : int
        Number of repeated messages.
    last_seq : int or None
        Sequence number of its last message; None for foreign or unreadable messages.
    lost_at_end : int or None
        Messages lost after that one; None if unknown.
    cut : bool
        Whether an unknown number of messages may be lost after it, by truncation or damage.
    """

    topic: Topic
    version: str
    gaps: list[Gap]
    duplicates: int
    last_seq: int | None
    lost_at_end: int | None
    cut: bool


@dataclass
class Examination:
    """Findings about a file that was read completely.

    Attributes
    ----------
    path : Path
    size_bytes : int
    contents : Contents
    topics : list of TopicState
    unreadable : dict of str to int
        Number of unreadable messages in intact records, by the reason.
    in_the_making : bool
        Whether the file is being written, so that a missing end is no fault.
    """

    path: Path
    size_bytes: int
    contents: Contents
    topics: list[TopicState]
    unreadable: dict[str, int] = field(default_factory=dict)
    in_the_making: bool = False

    @property
    def messages(self) -> int:
        """Number of messages of all topics; a picture and its packet count as one."""
        return sum(state.topic.messages for state in self.topics)

    @property
    def cut_bytes(self) -> int:
        """Bytes after the last intact record of a truncated file; 0 for other files."""
        return 0 if self.contents.complete else self.size_bytes - self.contents.end

    @property
    def whole(self) -> bool:
        """Whether the file has no fault: complete or still being written, and undamaged."""
        doubled = any(state.duplicates for state in self.topics)
        return (self.contents.complete or self.in_the_making) and not (
            self.contents.damages or self.unreadable or doubled or self.short
        )

    @property
    def short(self) -> bool:
        """Whether the file has fewer messages than its summary section counts."""
        return any(state.lost_at_end for state in self.topics)


def examine(path: str | Path) -> Examination:
    """Read a recording completely, and report its contents and faults.

    Raises
    ------
    UsageError
        When there is no such file.
    InputError
        When it can't be read, or isn't an MCAP file.
    """
    path = Path(path)
    with open_file(path) as stream:
        in_the_making = is_held(path)
        check_magic(path, stream)
        size = os.fstat(stream.fileno()).st_size
        reading = _Reading(read_contents(stream, size))
        contents = read_contents(stream, size, reading.take)
    in_the_making &= not contents.complete
    ends = contents.complete or in_the_making
    states = [_state(contents, topic, reading, ends) for topic in _topics(contents)]
    return Examination(path, size, contents, states, reading.unreadable, in_the_making)


class _Reading:
    """Takes the records of a file, and counts messages."""

    def __init__(self, contents: Contents) -> None:
        self._decoder = Decoder(None, contents.index)
        self.damages = 0
        self.numbers: dict[str, TopicNumbers] = {}
        self.unreadable: dict[str, int] = {}

    def take(self, found: IntactRecords | Damage) -> None:
        if isinstance(found, Damage):
            self.damages += 1
            return
        for part in found.parts or (found.record,):
            try:
                decoded = self._decoder.take(part)
            except (DamagedError, SchemaMismatch) as exc:
                why = str(exc)
                self.unreadable[why] = self.unreadable.get(why, 0) + 1
                continue
            if decoded is not None and part.opcode == Opcode.MESSAGE:
                topic, message, _ = decoded
                numbers = self.numbers.setdefault(topic, TopicNumbers())
                numbers.take(message.header, self.damages)


def _topics(contents: Contents) -> list[Topic]:
    """Return the topics with messages, and those that only the summary section mentions."""
    found = topics_of(contents.index)
    for name, count in (contents.messages_said or {}).items():
        if count:
            found.setdefault(name, Topic(name, "", 0, 0, 0))
    return list(found.values())


def _state(contents: Contents, topic: Topic, reading: _Reading, ends: bool) -> TopicState:
    numbers = reading.numbers.get(topic.name, TopicNumbers())
    closing = contents.metadata.get(CLOSING, {})
    gaps = numbers.gaps(count_of(closing.get(f"joined_at {topic.name}")))
    said = contents.messages_said
    recorded = None if said is None else said.get(topic.name, 0)
    lost = sum(gap.messages for gap in gaps if gap.damaged)
    return TopicState(
        topic,
        _version(contents, topic),
        gaps,
        numbers.duplicates,
        numbers.last.seq if numbers.last else None,
        None if recorded is None else max(recorded - topic.messages - lost, 0),
        not ends or (said is None and reading.damages > numbers.damages),
    )


def _version(contents: Contents, topic: Topic) -> str:
    versions = {
        channel.metadata.get(VERSION, "")
        for channel in contents.index.channels.values()
        if channel.topic in (topic.name, topic.name + COMPANION)
    }
    return ", ".join(sorted(versions - {""}))


def made_by(contents: Contents) -> str:
    """Return the program that made the file."""
    about = contents.metadata.get(ABOUT, {}).get("rsenf")
    return f"rsenf {about}" if about else contents.library or "unknown"
