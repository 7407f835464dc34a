"""Reads the messages of a recording, also of a truncated or damaged one."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Protocol, TypeVar

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rsenf.errors import InputError, SchemaMismatch, UsageError, reason_of
from rsenf.messages import Header, VideoPacket, class_for, decode
from rsenf.messages.codec import MEDIA_TYPE, header_of
from rsenf.record.container import (
    CHANNEL,
    MAGIC,
    DamagedError,
    Record,
    StoredMessage,
    check_magic,
    heads,
    unpack,
    unpack_message,
)
from rsenf.record.growing import ABOUT
from rsenf.record.index import Index
from rsenf.record.scan import Damage, IntactRecord, intact_records
from rsenf.record.summary import read_contents
from rsenf.record.topics import Route, picture_data, route_of, topics_of

T = TypeVar("T")
Given = TypeVar("Given", covariant=True)


class MessageDecoder:
    """Takes a file's records in order, and returns its messages.

    Parameters
    ----------
    topics : frozenset of str, optional
        Topics to decode; all by default.
    known : Index, optional
        Schemas and channels known in advance, as the chunk that defines them may be damaged.
    """

    def __init__(self, topics: frozenset[str] | None, known: Index | None = None) -> None:
        self._topics = topics
        self._schemas: dict[int, str] = {}
        self._routes: dict[int, Route] = {}
        self._others: set[int] = set()
        self._pictures: dict[str, tuple[str, StoredMessage]] = {}
        for schema in known.schemas.values() if known else ():
            self._schemas[schema.id] = schema.name
        for channel in known.channels.values() if known else ():
            self._open(channel)

    def take(self, record: Record) -> tuple[str, Any, int] | None:
        """Take a record; return topic, message and log time in ns when it completes a message.

        Raises
        ------
        SchemaMismatch
            When a message doesn't parse, or is of another version than this program's.
        DamagedError
            When the record is invalid.
        """
        if record.opcode == Opcode.MESSAGE:
            return self._message(record.body)
        if record.opcode == Opcode.SCHEMA:
            schema = unpack(Schema, record.body)
            self._schemas[schema.id] = schema.name
        elif record.opcode == Opcode.CHANNEL:
            self._open(unpack(Channel, record.body))
        return None

    def _open(self, channel: Any) -> None:
        route = route_of(channel, self._schemas.get(channel.schema_id, ""))
        wanted = self._topics is None or route.topic in self._topics
        if wanted and (route.is_ours or route.is_picture):
            self._routes[channel.id] = route
        else:
            self._others.add(channel.id)

    def _message(self, body: bytes) -> tuple[str, Any, int] | None:
        stored = unpack_message(body)
        if stored.channel_id in self._others:
            return None
        route = self._routes.get(stored.channel_id)
        if route is None:
            raise DamagedError("a message of a topic whose definition is lost")
        if route.is_picture:
            self._pictures[route.topic] = (route.schema, stored)
            return None
        try:
            message = self._decoded(route, stored)
        except SchemaMismatch as exc:
            raise SchemaMismatch(f"topic {route.topic}: {exc.message}", exc.hint) from exc
        return route.topic, message, stored.log_time_ns

    def _decoded(self, route: Route, stored: StoredMessage) -> Any:
        message = decode(class_for(f"{MEDIA_TYPE};{route.schema}/{route.version}"), stored.data)
        if isinstance(message, VideoPacket):
            return self._with_picture(route.topic, stored, message)
        return message

    def _with_picture(self, topic: str, stored: StoredMessage, packet: VideoPacket) -> VideoPacket:
        schema, picture = self._pictures.pop(topic, ("", None))
        if picture is None or packet.data or picture[1:3] != stored[1:3]:
            return packet  # a mark, or a codec without a Foxglove format
        data = picture_data(schema, picture.data)
        return dataclasses.replace(packet, data=data)


class _HeaderDecoder(MessageDecoder):
    """Returns the headers in place of the messages."""

    def _decoded(self, route: Route, stored: StoredMessage) -> Any:
        return header_of(stored.data)


class RecordConsumer(Protocol[Given]):
    """Interface of a consumer of records, which takes them in the order of the file."""

    def take(self, record: Record) -> Given | None:
        """Take a record; return what it completes, if anything.

        Raises SchemaMismatch or DamagedError for an invalid record.
        """
        ...


@dataclass
class Loss:
    """The unreadable part of a recording."""

    cut_bytes: int = 0  # bytes after the last complete record of a truncated file
    damaged: int = 0  # damaged chunks and other records, as far as has been read
    rejected: int = 0  # messages that didn't parse, in the latest tolerant reading
    why: str = ""  # reason for the first of them

    def __bool__(self) -> bool:
        return bool(self.cut_bytes or self.damaged or self.rejected)


class Recording:
    """An existing recording. Made by :func:`open_recording`.

    Attributes
    ----------
    path : Path
    complete : bool
        Whether the file has its end. Of a truncated file, all complete chunks are read.
    metadata : dict of str to dict of str to str
        Metadata records by name; records of the same name are merged.
    topics : dict of str to Topic
        Pictures and packets of a video count as one topic.
    loss : Loss
        What can't be read.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with open_file(self.path) as stream:
            check_magic(self.path, stream)
            contents = read_contents(stream, os.fstat(stream.fileno()).st_size)
        index = contents.index
        self._limit = contents.limit
        self._definitions = Index(schemas=index.schemas, channels=index.channels)
        self._known_damages = len(contents.damages)
        self.complete = contents.complete
        self.metadata = contents.metadata
        self.topics = topics_of(index)
        self.loss = Loss(cut_bytes=contents.cut_bytes, damaged=len(contents.damages))

    @property
    def lost(self) -> str:
        """The loss in one line; empty if everything can be read, as far as has been read."""
        loss, lost = self.loss, []
        if not self.complete:
            lost.append(f"the recording is cut short: its last {loss.cut_bytes} bytes are no use")
        if loss.damaged:
            lost.append(f"damaged parts, left out: {loss.damaged}")
        if loss.rejected:
            lost.append(f"messages that can't be read: {loss.rejected} ({loss.why})")
        return "; ".join(lost)

    def messages(
        self, topics: Collection[str] | None = None, *, tolerant: bool = False
    ) -> Iterator[tuple[str, Any, int]]:
        """Read messages in the order in which they were recorded.

        This order keeps video packets in decoding order, needs memory for one chunk only, and is
        the same for a truncated file. Log times increase within a topic (except for B frames), but
        not necessarily between topics.

        Parameters
        ----------
        topics : collection of str, optional
            Topics to read; by default all with messages of rsenf.
        tolerant : bool
            Whether to count unreadable messages in ``loss`` and continue, instead of raising.

        Yields
        ------
        topic : str
        message : a class of :mod:`rsenf.messages`
        log_time_ns : int

        Raises
        ------
        UsageError
            When there is no such topic, or it isn't of rsenf.
        SchemaMismatch
            When a message doesn't parse, or is of another version of its schema.
        InputError
            When a chunk is damaged.
        """
        wanted = None if topics is None else frozenset(map(self._known, topics))
        return self.found_by(MessageDecoder(wanted, self._definitions), tolerant=tolerant)

    def found_by(self, finder: RecordConsumer[T], *, tolerant: bool = False) -> Iterator[T]:
        """Read the results of a consumer of records, in the order of the file.

        Parameters
        ----------
        finder : RecordConsumer
            Takes each record, also those in chunks, and returns what it completes.
        tolerant : bool
            As for :meth:`messages`, which raises the same errors.
        """
        self.loss.damaged, self.loss.rejected = self._known_damages, 0
        self._damages = 0
        with open_file(self.path) as stream:
            for found in intact_records(stream, self._limit):
                if isinstance(found, Damage):
                    if self.complete or not found.breaks_off:
                        self._refuse_damaged(found.why, tolerant)
                    continue
                for part in found.parts or (found.record,):
                    taken = self._taken(finder, part, tolerant)
                    if taken is not None:
                        yield taken

    def _known(self, topic: str) -> str:
        found = self.topics.get(topic)
        if found is None:
            there = ", ".join(self.topics) or "none"
            raise UsageError(f"{self.path}: no topic {topic!r}", f"its topics: {there}")
        if not found.is_ours:
            raise UsageError(f"{self.path}: {topic!r} carries {found.schema}, which isn't rsenf's")
        return topic

    def _taken(self, finder: RecordConsumer[T], record: Record, tolerant: bool) -> T | None:
        try:
            return finder.take(record)
        except DamagedError as exc:
            self._refuse_damaged(str(exc), tolerant)
        except SchemaMismatch as exc:
            if not tolerant:
                made_by = self.metadata.get(ABOUT, {}).get("rsenf", "unknown")
                hint = f"the recording was made by rsenf {made_by}"
                raise SchemaMismatch(f"{self.path}: {exc.message}", hint) from exc
            self.loss.why = self.loss.why if self.loss.rejected else exc.message
            self.loss.rejected += 1
        return None

    def _refuse_damaged(self, why: str, tolerant: bool) -> None:
        if not tolerant:
            raise InputError(f"{self.path}: damaged, {why}", "'rsenf recover' saves what is whole")
        self._damages += 1
        self.loss.damaged = max(self._damages, self._known_damages)


def open_recording(path: str | Path) -> Recording:
    """Open a recording.

    Raises
    ------
    UsageError
        When there is no such file.
    InputError
        When it can't be read, or isn't an MCAP file.
    """
    return Recording(path)


def last_headers(path: Path) -> dict[str, Header]:
    """Return the header of each topic's newest message, as far as it can be read.

    Of the chunks, only those are read that define a channel or hold its last message, as their
    message indexes tell.

    Parameters
    ----------
    path : Path
        A recording, which needn't have an end.

    Raises
    ------
    UsageError, InputError
        As :func:`open_recording`.
    """
    first: dict[bytes, tuple[int, int]] = {}
    last: dict[bytes, tuple[int, int]] = {}
    found: dict[str, Header] = {}
    chunk, decoder = (0, 0), _HeaderDecoder(None)
    with open_file(path) as stream:
        check_magic(path, stream)
        for opcode, start, end in heads(stream, len(MAGIC), os.fstat(stream.fileno()).st_size):
            if opcode == Opcode.CHUNK:
                chunk = start, end
            elif opcode == Opcode.MESSAGE_INDEX:
                channel = stream.read(CHANNEL.size)
                first.setdefault(channel, chunk)
                last[channel] = chunk
        # The last chunk may have lost its message indexes.
        for start, end in sorted({*first.values(), *last.values(), chunk}):
            for intact in intact_records(stream, end, start):
                for part in intact.parts if isinstance(intact, IntactRecord) else ():
                    with suppress(DamagedError, SchemaMismatch):
                        if taken := decoder.take(part):
                            topic, new = taken[:2]
                            old = found.get(topic, new)
                            is_late = (old.epoch, old.seq) > (new.epoch, new.seq)
                            found[topic] = old if is_late and old.run_id == new.run_id else new
    return found


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading; raises as :func:`open_recording`."""
    try:
        return open(path, "rb")
    except FileNotFoundError as exc:
        raise UsageError(f"{path}: no such file") from exc
    except IsADirectoryError as exc:
        raise UsageError(f"{path}: this is a folder", "name a file in it") from exc
    except OSError as exc:
        raise InputError(f"{path}: {reason_of(exc)}") from exc
