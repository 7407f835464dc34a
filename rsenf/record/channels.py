"""MCAP channels: one for each topic, with its schema embedded so that any program can read it."""

from __future__ import annotations

from typing import Any

from mcap.records import Channel, Schema

from rsenf.errors import SchemaMismatch
from rsenf.messages import VideoPacket, descriptor_set, schema_name
from rsenf.record import foxglove
from rsenf.record.chunk import ChunkBuilder
from rsenf.record.container import pack
from rsenf.record.index import Index

PROTOBUF = "protobuf"
VERSION = "schema_version"
# The pictures of a video topic use Foxglove's schema. A companion topic holds the packets without
# the pictures: sequence numbers, clocks, key frames, marks.
COMPANION = "/index"


class Channels:
    """Creates channels, and writes each with its schema before its first message.

    Parameters
    ----------
    index : Index
        Index of the file.
    chunk : ChunkBuilder
        Takes the records.
    """

    def __init__(self, index: Index, chunk: ChunkBuilder) -> None:
        self._index = index
        self._chunk = chunk
        self._classes: dict[str, type[Any]] = {}
        self._schema_ids: dict[str, int] = {}
        self._channel_ids: dict[tuple[str, str], int] = {}

    def check(self, topic: str, cls: type[Any]) -> None:
        """Check that a topic keeps the class of its first message.

        Raises
        ------
        SchemaMismatch
            When the topic had messages of another class before.
        """
        first = self._classes.setdefault(topic, cls)
        if first is not cls:
            raise SchemaMismatch(f"{topic} carries {first.__name__}, not {cls.__name__}")

    def of_messages(self, topic: str, cls: type[Any]) -> int:
        """Return the channel for messages of a class."""
        known = self._channel_ids.get((topic, cls.__name__))
        return known or self._new(
            topic, cls.__name__, schema_name(cls), {VERSION: str(cls.VERSION)}
        )

    def of_pictures(self, topic: str, schema: str) -> int:
        """Return the channel for the pictures of a video topic."""
        known = self._channel_ids.get((topic, schema))
        return known or self._new(topic, schema, schema, {"packets": topic + COMPANION})

    def of_packets(self, topic: str) -> int:
        """Return the channel for the packets of a video topic, without their pictures."""
        return self.of_messages(topic + COMPANION, VideoPacket)

    def _new(self, topic: str, key: str, schema: str, metadata: dict[str, str]) -> int:
        number = len(self._channel_ids) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding=PROTOBUF,
            metadata=metadata,
            schema_id=self._schema(schema),
        )
        self._channel_ids[topic, key] = number
        self._index.channels[number] = channel
        self._chunk.add(pack(channel))
        return number

    def _schema(self, name: str) -> int:
        known = self._schema_ids.get(name)
        if known:
            return known
        described = foxglove.descriptor_set(name) if foxglove.knows(name) else descriptor_set()
        number = self._schema_ids[name] = len(self._schema_ids) + 1
        schema = Schema(id=number, name=name, encoding=PROTOBUF, data=described)
        self._index.schemas[number] = schema
        self._chunk.add(pack(schema))
        return number
