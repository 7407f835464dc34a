"""Finds the pictures among the records of an MCAP file."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rsenf.errors import SchemaMismatch
from rsenf.record.container import Record, unpack, unpack_message
from rsenf.run.foreign import foxglove, ros
from rsenf.run.foreign.picture import Picture

Reader = Callable[[bytes], Picture]
_ENCODINGS: dict[str, Callable[[str], Reader | None]] = {
    "cdr": ros.reader_of,
    "protobuf": foxglove.protobuf_reader,
    "json": foxglove.json_reader,
}


def holds_pictures(schema: str) -> bool:
    """Whether messages of a schema hold pictures, in any encoding."""
    return any(reader(schema) is not None for reader in _ENCODINGS.values())


def _unreadable(schema: str, encoding: str) -> Reader:
    def refuse(_payload: bytes) -> Picture:
        raise SchemaMismatch(f"{schema} encoded as {encoding!r} isn't known")

    return refuse


class Found(NamedTuple):
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

    def take(self, record: Record) -> Found | None:
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

    def _picture(self, body: bytes) -> Found | None:
        topic, reader = self._readers.get(int.from_bytes(body[:2], "little"), ("", None))
        if reader is None:
            return None
        stored = unpack_message(body)
        try:
            return Found(topic, reader(stored.data), stored.log_time_ns)
        except SchemaMismatch as exc:
            raise SchemaMismatch(f"topic {topic}: {exc.message}", exc.hint) from exc
