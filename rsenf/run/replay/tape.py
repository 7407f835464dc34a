"""Reads the topics of a recording merged in the order of time, from any moment on.

Which topics are replayed, and under which keys on the bus, is chosen here.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Collection, Iterable, Iterator, Mapping
from itertools import groupby
from operator import itemgetter
from typing import Any, NamedTuple

from rsenf.bus.keys import (
    NAME_RULE,
    REFERENCE,
    ROOT,
    TOPICS,
    is_name,
    matches,
    renamed,
    source_of,
    topic_of,
)
from rsenf.errors import UsageError
from rsenf.messages import Frame, Mark, ReferenceBlock, VideoPacket
from rsenf.record.reader import Recording, open_recording
from rsenf.run.replay.control import REORDERED_NS

VIDEO, FRAMES, HEALTH = "video", "frames", "health"


def chosen(
    recording: Recording,
    wanted: Collection[str] = (),
    rename: Mapping[str, str] | None = None,
    site: str = "",
) -> dict[str, str]:
    """Choose topics of a recording.

    Parameters
    ----------
    recording : Recording
    wanted : collection of str
        Key expressions below the site, such as ``cam1/rows``, ``*/track`` or ``reference/ce``;
        ``frames`` stands for the decoded video. If empty: all topics, without decoding video.
    rename : mapping, optional
        New names by old, of cameras (``door``) or topics (``door/rows``, ``reference/ce``).
    site : str
        Site to replay to; the recorded one if empty.

    Returns
    -------
    dict of str to str
        Key on the bus by recorded key.

    Raises
    ------
    UsageError
        When a wanted topic doesn't exist, or a new name is not valid.
    """
    there = _playable(recording)
    found = dict.fromkeys(k for k in there if topic_of(k) != FRAMES) if not wanted else {}
    for expr in wanted:
        hits = [key for key in there if matches(expr, _below(key))]
        if not hits:
            raise UsageError(f"{recording.path}: nothing to play as {expr!r}", _hint(there, expr))
        found.update(dict.fromkeys(hits))
    if not found:
        raise UsageError(f"{recording.path}: holds nothing that could be played")
    names = {
        key: f"{ROOT}/{site or key.split('/')[1]}/{renamed(_below(key), rename or {})}"
        for key in found
    }
    _check(recording, names, rename or {})
    return names


def as_named(message: Any, key: str) -> Any:
    """Return a message with the source, and for a reference the grid, of its key."""
    grid = key.split("/")[3] if topic_of(key) == REFERENCE else ""
    source = f"{REFERENCE}/{grid}" if grid else source_of(key)
    message = dataclasses.replace(
        message, header=dataclasses.replace(message.header, source=source)
    )
    return (
        dataclasses.replace(message, grid=grid) if isinstance(message, ReferenceBlock) else message
    )


def _playable(recording: Recording) -> list[str]:
    """Return the keys that can be replayed: not health; frames only where there is a video."""
    keys = [k for k, t in recording.topics.items() if t.is_ours and k.startswith(f"{ROOT}/")]
    signals = [k for k in keys if topic_of(k) in TOPICS and topic_of(k) not in (HEALTH, FRAMES)]
    return [*signals, *(with_topic(k, FRAMES) for k in signals if topic_of(k) == VIDEO)]


def with_topic(key: str, topic: str) -> str:
    """Return the key of another topic of the same camera."""
    return f"{key.rpartition('/')[0]}/{topic}"


def _below(key: str) -> str:
    return key.split("/", 2)[2]


def _hint(there: list[str], expr: str) -> str:
    if expr.endswith(f"/{FRAMES}"):
        return "frames are decoded from the recorded video, which isn't there; take the rows"
    return f"there is: {', '.join(map(_below, there)) or 'nothing'}"


def _check(recording: Recording, names: Mapping[str, str], rename: Mapping[str, str]) -> None:
    for old in rename:
        if not any(_below(key) == old or _below(key).split("/")[0] == old for key in names):
            raise UsageError(f"{recording.path}: {old!r} isn't played, so it can't be renamed")
    for key, name in names.items():
        parts = name.split("/")
        if len(parts) != len(key.split("/")) or not all(map(is_name, parts)):
            raise UsageError(f"{name!r} is no name for a topic", NAME_RULE)
        if TOPICS.get(topic_of(name)) is not TOPICS[topic_of(key)]:
            raise UsageError(
                f"{_below(key)!r} can't be played as {_below(name)!r}: another message"
            )
        others = [other for other, also in names.items() if also == name]
        if len(others) > 1:
            raise UsageError(f"{' and '.join(others)} would both be {name}", "rename one of them")


class Played(NamedTuple):
    """A message at its time."""

    time_ns: int
    key: str
    message: Any


class Tape:
    """Plays a recording's topics from any moment on. Unreadable parts are left out and counted.

    Each topic has its own reader, since a recording isn't ordered in time between topics: a
    tracker may have been minutes behind a decoder. Nor is it within a topic: frames may be stored
    in coding order, and several passes side by side.

    Parameters
    ----------
    recording : Recording
        The recording.
    names : mapping
        Key on the bus by recorded key.

    Attributes
    ----------
    first_ns, last_ns : int
        Times of the first and the last message of all streams.
    """

    def __init__(self, recording: Recording, names: Mapping[str, str]) -> None:
        self.path, self.names = recording.path, names
        spans = [
            (t.first_ns, t.last_ns)
            for key, t in recording.topics.items()
            if t.is_ours and topic_of(key) not in (REFERENCE, HEALTH)
        ]
        self.first_ns = min((first for first, _ in spans), default=0)
        self.last_ns = max((last for _, last in spans), default=0)
        self._recording = recording
        self._readers = [recording]

    def references(self) -> Iterator[tuple[str, Any]]:
        """Play the references as a whole: they have no stream time."""
        for recorded, key in self.names.items():
            if topic_of(key) == REFERENCE:
                for _, message in self._messages(recorded, to_ns=None):
                    yield key, message

    def play(self, from_ns: int, to_ns: int) -> Iterator[Played]:
        """Play the streams between two times (ns), the second excluded.

        A video begins with the key frame that its first picture needs.
        """
        self._readers = [self._worst]
        streams = [
            self._stream(recorded, key, from_ns, to_ns)
            for recorded, key in self.names.items()
            if topic_of(key) != REFERENCE
        ]
        return heapq.merge(*streams, key=itemgetter(0))

    @property
    def loss(self) -> str:
        """What could not be read, in one line; empty for nothing."""
        return self._worst.lost

    @property
    def _worst(self) -> Recording:
        """Return the reader with most damage: the readers of all topics meet the same chunks."""
        return max(self._readers, key=lambda r: (r.loss.damaged, r.loss.rejected))

    def _stream(self, recorded: str, key: str, from_ns: int, to_ns: int) -> Iterator[Played]:
        topic = topic_of(recorded)
        if topic == FRAMES:
            frames = self._frames(recorded, from_ns, to_ns)
            return (Played(t, key, frame) for t, frame in frames if from_ns <= t < to_ns)
        timed = self._messages(recorded, to_ns)
        if topic == VIDEO:
            return (Played(t, key, m) for t, m in _decodable(timed, from_ns) if t < to_ns)
        return (Played(t, key, m) for t, m in timed if from_ns <= t < to_ns)

    def _frames(self, recorded: str, from_ns: int, to_ns: int) -> Iterator[tuple[int, Frame]]:
        from rsenf.run.replay.pictures import pictures  # imports FFmpeg

        packets = self._messages(with_topic(recorded, VIDEO), to_ns)
        known = self._messages(recorded, None) if recorded in self._recording.topics else iter(())
        return pictures(packets, from_ns, next((frame for _, frame in known), Frame()))

    def _messages(self, recorded: str, to_ns: int | None) -> Iterator[tuple[int, Any]]:
        """Read the data of one topic up to a time, and beyond where order in time isn't certain."""
        reader = open_recording(self.path)
        # Reordered pictures are late by less than the first, further passes by the second.
        late_ns = max(REORDERED_NS, self._recording.topics[recorded].back_ns)
        self._readers.append(reader)
        for _, message, time_ns in reader.messages([recorded], tolerant=True):
            if to_ns is not None and time_ns >= to_ns + late_ns:
                return
            if message.header.mark == Mark.DATA:
                yield time_ns, message


def _decodable(
    packets: Iterable[tuple[int, VideoPacket]], from_ns: int
) -> Iterator[tuple[int, VideoPacket]]:
    """Apply :func:`from_key_frame` to every pass of the recording."""
    from rsenf.run.replay.pictures import from_key_frame

    for _, stretch in groupby(packets, key=lambda p: (p[1].header.run_id, p[1].header.epoch)):
        yield from from_key_frame(stretch, from_ns)
