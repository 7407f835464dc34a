"""Decodes the records of a file to messages."""

from __future__ import annotations

import dataclasses
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from rsenf.errors import SchemaMismatch
from rsenf.messages import VideoPacket, class_for, decode
from rsenf.messages.codec import MEDIA_TYPE
from rsenf.record import foxglove
from rsenf.record.container import DamagedError, Record, StoredMessage, unpack, unpack_message
from rsenf.record.index import Index
from rsenf.record.topics import Route, route_of


class Decoder:
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
            message = decode(class_for(f"{MEDIA_TYPE};{route.schema}/{route.version}"), stored.data)
            if isinstance(message, VideoPacket):
                message = self._with_picture(route.topic, stored, message)
        except SchemaMismatch as exc:
            raise SchemaMismatch(f"topic {route.topic}: {exc.message}", exc.hint) from exc
        return route.topic, message, stored.log_time_ns

    def _with_picture(self, topic: str, stored: StoredMessage, packet: VideoPacket) -> VideoPacket:
        schema, picture = self._pictures.pop(topic, ("", None))
        if picture is None or packet.data or picture[1:3] != stored[1:3]:
            return packet  # a mark, or a codec without a Foxglove format
        data = foxglove.picture_data(schema, picture.data)
        return dataclasses.replace(packet, data=data)
