"""Examines a recording: its contents, missing messages, and damage of the file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from rsenf.errors import SchemaMismatch
from rsenf.messages import Header
from rsenf.record.container import DamagedError, check_magic
from rsenf.record.growing import ABOUT, CLOSING
from rsenf.record.output import is_held
from rsenf.record.reader import MessageDecoder, open_file
from rsenf.record.scan import Contents, Damage, IntactRecord
from rsenf.record.sequence import Numbers, count_of
from rsenf.record.summary import read_contents
from rsenf.record.topics import COMPANION, VERSION, Topic, topics_of

RECOVERED = "rsenf.recovered"


class MissingRange(NamedTuple):
    """A range of missing sequence numbers."""

    run_id: str
    epoch: int
    first: int  # both inclusive
    last: int
    damaged: bool  # whether the file is damaged there. Otherwise the messages were never recorded

    @property
    def messages(self) -> int:
        """Number of missing messages."""
        return self.last - self.first + 1


@dataclass
class _Stream:
    numbers: Numbers = field(default_factory=Numbers)
    last: int = -1  # highest number so far
    damages: int = 0  # damaged places of the file before its last message
    hit: list[tuple[int, int]] = field(default_factory=list)  # numbers around damage

    @property
    def begins_with_damage(self) -> bool:
        return bool(self.hit) and self.hit[0][0] < 0


@dataclass
class TopicNumbers:
    """Counts a topic's messages, taken in the order of the file."""

    messages: int = 0
    duplicates: int = 0
    last: Header | None = None  # header of the last message
    damages: int = 0  # number of damaged places of the file before that one
    _streams: dict[tuple[str, int], _Stream] = field(default_factory=dict)

    def take(self, header: Header, damages: int) -> None:
        """Take a message; ``damages`` is the number of damaged places of the file before it."""
        stream = self._streams.setdefault((header.run_id, header.epoch), _Stream())
        self.messages += 1
        self.duplicates += not stream.numbers.add(header.seq)
        if damages > stream.damages:
            stream.hit.append((stream.last, header.seq))
        stream.damages = damages
        stream.last = max(stream.last, header.seq)
        self.last, self.damages = header, damages

    def gaps(self, joined_at: int | None) -> list[MissingRange]:
        """Return what is missing between the first and the last number of each stream.

        Parameters
        ----------
        joined_at : int or None
            First number recorded of the first stream; earlier ones don't count as missing. None if
            unknown: then it is the first number found, or 0 after damage.
        """
        found = []
        for place, ((run_id, epoch), stream) in enumerate(self._streams.items()):
            start = 0 if place or stream.begins_with_damage else stream.numbers.first
            if place == 0 and joined_at is not None:
                start = joined_at
            for hole in stream.numbers.holes(start):
                damaged = any(a < hole.stop and hole.start <= b for a, b in stream.hit)
                found.append(MissingRange(run_id, epoch, hole.start, hole.stop - 1, damaged))
        return found


class TopicState(NamedTuple):
    """One topic of a recording."""

    topic: Topic
    version: str  # version of its schema; empty for foreign schemas
    gaps: list[MissingRange]
    duplicates: int  # number of repeated messages
    # sequence number of its last message; None for foreign or unreadable messages
    last_seq: int | None
    lost_at_end: int | None  # messages lost after that one; None if unknown
    cut: bool  # whether an unknown number of messages may be lost after it, by truncation or damage


@dataclass
class Examination:
    """Findings about a file that was read completely."""

    path: Path
    size_bytes: int
    contents: Contents
    topics: list[TopicState]
    # number of unreadable messages in intact records, by the reason
    unreadable: dict[str, int] = field(default_factory=dict)
    # whether the file is being written, so that a missing end is no fault
    in_the_making: bool = False

    @property
    def messages(self) -> int:
        """Number of messages of all topics; a picture and its packet count as one."""
        return sum(state.topic.messages for state in self.topics)

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
        self._decoder = MessageDecoder(None, contents.index)
        self.damages = 0
        self.numbers: dict[str, TopicNumbers] = {}
        self.unreadable: dict[str, int] = {}

    def take(self, found: IntactRecord | Damage) -> None:
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
            if decoded is not None:
                topic, message, _ = decoded
                numbers = self.numbers.setdefault(topic, TopicNumbers())
                numbers.take(message.header, self.damages)


def _topics(contents: Contents) -> list[Topic]:
    """Return the topics with messages, and those that only the summary section mentions."""
    found = topics_of(contents.index)
    for name, count in (contents.summary_messages or {}).items():
        if count:
            found.setdefault(name, Topic(name, "", 0, 0, 0))
    return list(found.values())


def _state(contents: Contents, topic: Topic, reading: _Reading, ends: bool) -> TopicState:
    numbers = reading.numbers.get(topic.name, TopicNumbers())
    closing = contents.metadata.get(CLOSING, {})
    gaps = numbers.gaps(count_of(closing.get(f"joined_at {topic.name}")))
    counts = contents.summary_messages
    recorded = None if counts is None else counts.get(topic.name, 0)
    lost = sum(gap.messages for gap in gaps if gap.damaged)
    return TopicState(
        topic,
        _version(contents, topic),
        gaps,
        numbers.duplicates,
        numbers.last.seq if numbers.last else None,
        None if recorded is None else max(recorded - topic.messages - lost, 0),
        not ends or (counts is None and reading.damages > numbers.damages),
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
