"""Finds the pictures among the records of an MCAP file of another program.

Its topics with pictures are the cameras, under names that are valid in rsenf. One of them can be
the input of a one-process command.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rsenf.errors import InputError, SchemaMismatch, UsageError
from rsenf.messages import Frame
from rsenf.record import Recording
from rsenf.record.container import Record, unpack, unpack_message
from rsenf.run.foreign.pictures import Picture, cdr_reader, json_reader, protobuf_reader
from rsenf.run.foreign.stream import Item, PictureStream
from rsenf.run.inputs import Input

Reader = Callable[[bytes], Picture]
_ENCODINGS: dict[str, Callable[[str], Reader | None]] = {
    "cdr": cdr_reader,
    "protobuf": protobuf_reader,
    "json": json_reader,
}


def holds_pictures(schema: str) -> bool:
    """Whether messages of a schema hold pictures, in any encoding."""
    return any(reader(schema) is not None for reader in _ENCODINGS.values())


def _unreadable(schema: str, encoding: str) -> Reader:
    def refuse(_payload: bytes) -> Picture:
        raise SchemaMismatch(f"{schema} encoded as {encoding!r} isn't known")

    return refuse


class FoundPicture(NamedTuple):
    """A picture and where it was found."""

    topic: str
    picture: Picture
    log_time_ns: int


class Finder:
    """Takes the records of a file in order and returns its pictures.

    Parameters
    ----------
    topics : frozenset of str
        Topics to read.
    """

    def __init__(self, topics: frozenset[str]) -> None:
        self._topics = topics
        self._schemas: dict[int, str] = {}
        self._readers: dict[int, tuple[str, Reader]] = {}

    def take(self, record: Record) -> FoundPicture | None:
        """Take a record; return the picture in it, if any.

        Raises
        ------
        SchemaMismatch
            When a message doesn't match its schema, or has an unknown format.
        DamagedError
            When the record is damaged.
        """
        if record.opcode == Opcode.SCHEMA:
            schema = unpack(Schema, record.body)
            self._schemas[schema.id] = schema.name
        elif record.opcode == Opcode.CHANNEL:
            self._note(unpack(Channel, record.body))
        elif record.opcode == Opcode.MESSAGE:
            return self._picture(record.body)
        return None

    def _note(self, channel: Channel) -> None:
        if channel.topic not in self._topics:
            return
        schema, encoding = self._schemas.get(channel.schema_id, ""), channel.message_encoding
        reader_of = _ENCODINGS.get(encoding)
        reader = reader_of(schema) if reader_of else None
        if reader is not None:
            self._readers[channel.id] = channel.topic, reader
        elif holds_pictures(schema):
            self._readers[channel.id] = channel.topic, _unreadable(schema, encoding)

    def _picture(self, body: bytes) -> FoundPicture | None:
        topic, reader = self._readers.get(int.from_bytes(body[:2], "little"), ("", None))
        if reader is None:
            return None
        stored = unpack_message(body)
        try:
            return FoundPicture(topic, reader(stored.data), stored.log_time_ns)
        except SchemaMismatch as exc:
            raise SchemaMismatch(f"topic {topic}: {exc.message}", exc.hint) from exc


def picture_topics(recording: Recording) -> dict[str, str]:
    """Return the topics with pictures by camera name, in the file's order.

    Topic ``/front/image_raw`` becomes camera ``front_image_raw``.
    """
    names: dict[str, str] = {}
    for topic in recording.topics.values():
        if holds_pictures(topic.schema):
            plain = re.sub("[^A-Za-z0-9.-]+", "_", topic.name).strip("_.-")[:48] or "camera"
            name, number = plain, 1
            while name in names or name == "reference":
                number += 1
                name = f"{plain}_{number}"
            names[name] = topic.name
    return names


def choose_camera(recording: Recording, cameras: dict[str, str], camera: str) -> str:
    """Return the name of a camera.

    Parameters
    ----------
    recording : Recording
    cameras : dict of str to str
        As :func:`picture_topics` returns them.
    camera : str
        Its name or topic; '' for the only one.

    Raises
    ------
    UsageError
        When there is no such camera, or several and none is named.
    """
    there = ", ".join(cameras)
    if not camera and len(cameras) > 1:
        raise UsageError(
            f"{recording.path} has several cameras: {there}", "choose one with --camera"
        )
    for name, topic in cameras.items():
        if camera in ("", name, topic):
            return name
    raise UsageError(f"{recording.path} has no pictures of camera {camera!r}", f"only of: {there}")


class ForeignVideo(Input):
    """Frames of one camera of a foreign MCAP file.

    Parameters
    ----------
    recording : Recording
        A file with pictures.
    camera : str
        Name or topic of the camera; '' for the only one.
    source : str
        ``source`` of the message headers.

    Raises
    ------
    UsageError
        When there is no such camera, or several and none is named.
    """

    begins_with = "frames"
    tells_arrival = True

    def __init__(self, recording: Recording, camera: str, source: str) -> None:
        cameras = picture_topics(recording)
        self._topic = cameras[choose_camera(recording, cameras, camera)]
        self._recording, self._stream = recording, PictureStream(source)
        self.name, self.path = recording.path.name, recording.path
        found = recording.topics[self._topic]
        self.duration_s = (found.last_ns - found.first_ns) / 1e9

    def messages(self) -> Iterator[Frame]:
        """Yield all frames that can be decoded.

        Raises
        ------
        InputError
            When there is none.
        """
        some = False
        for item in self._items():
            if isinstance(item, Frame):
                some = True
                yield item
        if not some:
            raise InputError(f"{self._recording.path}: no picture can be decoded", self.loss)

    def _items(self) -> Iterator[Item]:
        for found in self._recording.found_by(Finder(frozenset([self._topic])), tolerant=True):
            yield from self._stream.feed(found.picture, found.log_time_ns)
        yield from self._stream.finish()

    @property
    def loss(self) -> str:
        """What could not be read of the file and its pictures, in one line."""
        return "; ".join(filter(None, [self._recording.lost, self._stream.loss]))

    @property
    def warnings(self) -> list[str]:
        """Warnings about the pictures' times, one line each."""
        return self._stream.warnings
