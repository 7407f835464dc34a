"""Topics, their MCAP channels and embedded schemas; video in those of Foxglove.

A channel embeds its schema, so that any program can read it. Pictures are recorded as
``foxglove.CompressedVideo`` or ``foxglove.CompressedImage``, in the first four fields published in
https://github.com/foxglove/foxglove-sdk, folder ``schemas/proto``, so that common players show
them. A companion channel holds the packets without the pictures; both count as one topic.
Foxglove can't play video with B frames; such a stream is recorded nevertheless, packet by packet in
decoding order.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

from mcap.records import Channel, Schema

from rsenf.errors import SchemaMismatch
from rsenf.messages import VideoPacket, descriptor_set, schema_name
from rsenf.messages.schema import PACKAGE
from rsenf.record.container import pack
from rsenf.record.index import ChunkBuilder, Extent, Index, Stretch

VIDEO = "foxglove.CompressedVideo"
IMAGE = "foxglove.CompressedImage"
RAW = "foxglove.RawImage"  # of other programs only
# Field -> number and kind. A stamp is a google.protobuf.Timestamp.
FIELDS = {
    VIDEO: {
        "timestamp": (1, "stamp"), "frame_id": (2, "string"), "data": (3, "bytes"),
        "format": (4, "string"),
    },
    IMAGE: {
        "timestamp": (1, "stamp"), "frame_id": (4, "string"), "data": (2, "bytes"),
        "format": (3, "string"),
    },
    RAW: {
        "timestamp": (1, "stamp"), "frame_id": (7, "string"), "width": (2, "fixed32"),
        "height": (3, "fixed32"), "encoding": (4, "string"), "step": (5, "fixed32"),
        "data": (6, "bytes"),
    },
}  # fmt: skip
_FORMATS = {
    "h264": (VIDEO, "h264"),
    "hevc": (VIDEO, "h265"),
    "vp9": (VIDEO, "vp9"),
    "av1": (VIDEO, "av1"),
    "mjpeg": (IMAGE, "jpeg"),
    "png": (IMAGE, "png"),
    "webp": (IMAGE, "webp"),
}
PROTOBUF = "protobuf"
VERSION = "schema_version"
# The pictures of a video topic use Foxglove's schema. A companion topic holds the packets without
# the pictures: sequence numbers, clocks, key frames, marks.
COMPANION = "/index"
PACKETS = schema_name(VideoPacket)


class Picture(NamedTuple):
    """A packet in one of Foxglove's schemas."""

    schema: str
    payload: bytes


def to_foxglove(packet: Any, time_ns: int) -> Picture | None:
    """Convert a packet to one of Foxglove's schemas.

    Parameters
    ----------
    packet : VideoPacket
        The packet, or its Protobuf twin.
    time_ns : int
        Its log time, UTC since 1970.

    Returns
    -------
    Picture or None
        None for a codec that Foxglove doesn't support.
    """
    schema, name = _FORMATS.get(packet.codec, ("", ""))
    if not schema:
        return None
    made = foxglove_classes()[schema](frame_id=packet.header.source, data=packet.data, format=name)
    made.timestamp.seconds, made.timestamp.nanos = divmod(time_ns, 1_000_000_000)
    return Picture(schema, bytes(made.SerializeToString(deterministic=True)))


def picture_data(schema: str, payload: bytes) -> bytes:
    """Return the compressed picture in a message of one of the two schemas.

    Parameters
    ----------
    schema : str
        VIDEO or IMAGE.
    payload : bytes
        The serialised message.

    Raises
    ------
    SchemaMismatch
        When the bytes aren't such a message.
    """
    from google.protobuf.message import DecodeError

    try:
        return bytes(foxglove_classes()[schema].FromString(payload).data)
    except DecodeError as exc:
        raise SchemaMismatch(f"{len(payload)} bytes that are not a {schema}") from exc


def descriptor_set_of(schema: str) -> bytes:
    """Describe a schema of Foxglove or of rsenf, as a serialised ``FileDescriptorSet``."""
    from google.protobuf import descriptor_pb2

    if schema not in FIELDS:
        return descriptor_set()
    files = descriptor_pb2.FileDescriptorSet(file=[_timestamp_file(), _file(schema)])
    return bytes(files.SerializeToString(deterministic=True))


def _timestamp_file() -> Any:
    from google.protobuf import descriptor_pb2, timestamp_pb2

    described = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(described)
    return described


def _file(schema: str) -> Any:
    from google.protobuf import descriptor_pb2

    package, _, name = schema.partition(".")
    timestamps = _timestamp_file()
    out = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto",
        package=package,
        syntax="proto3",
        dependency=[timestamps.name],
    )
    kinds = descriptor_pb2.FieldDescriptorProto
    described = out.message_type.add(name=name)
    for field, (number, kind) in FIELDS[schema].items():
        made = described.field.add(name=field, number=number, label=kinds.LABEL_OPTIONAL)
        if kind == "stamp":
            made.type, made.type_name = kinds.TYPE_MESSAGE, ".google.protobuf.Timestamp"
        else:
            made.type = getattr(kinds, f"TYPE_{kind.upper()}")
    return out


@functools.cache
def foxglove_classes() -> dict[str, Any]:
    """Return the Protobuf classes of Foxglove's schemas, by schema."""
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for described in (_timestamp_file(), *map(_file, FIELDS)):
        pool.AddSerializedFile(described.SerializeToString())
    return {
        schema: message_factory.GetMessageClass(pool.FindMessageTypeByName(schema))
        for schema in FIELDS
    }


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
        version = {VERSION: str(cls.VERSION)}
        return self._channel(topic, cls.__name__, schema_name(cls), version)

    def of_pictures(self, topic: str, schema: str) -> int:
        """Return the channel for the pictures of a video topic."""
        return self._channel(topic, schema, schema, {"packets": topic + COMPANION})

    def of_packets(self, topic: str) -> int:
        """Return the channel for the packets of a video topic, without their pictures."""
        return self.of_messages(topic + COMPANION, VideoPacket)

    def _channel(self, topic: str, key: str, schema: str, metadata: dict[str, str]) -> int:
        if known := self._channel_ids.get((topic, key)):
            return known
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
        if known := self._schema_ids.get(name):
            return known
        described = descriptor_set_of(name)
        number = self._schema_ids[name] = len(self._schema_ids) + 1
        schema = Schema(id=number, name=name, encoding=PROTOBUF, data=described)
        self._index.schemas[number] = schema
        self._chunk.add(pack(schema))
        return number


class Route(NamedTuple):
    """Topic, schema and schema version of a channel's messages."""

    topic: str
    schema: str
    version: str

    @property
    def is_ours(self) -> bool:
        """Whether the channel carries messages of rsenf."""
        return _is_ours(self.schema)

    @property
    def is_picture(self) -> bool:
        """Whether the channel carries the pictures of a video topic."""
        return self.schema in (VIDEO, IMAGE)


def route_of(channel: Any, schema: str) -> Route:
    """Return the route of a channel; pictures and packets of a video have the same topic."""
    topic = channel.topic.removesuffix(COMPANION) if schema == PACKETS else channel.topic
    return Route(topic, schema, channel.metadata.get(VERSION, ""))


@dataclass(frozen=True)
class Topic:
    """One topic of a recording."""

    name: str
    schema: str
    messages: int
    first_ns: int
    last_ns: int
    stretches: tuple[Stretch, ...] = ()  # times with messages, separated by more than half a second
    back_ns: int = 0  # largest step back of its log times; 0 if they only increase

    @property
    def is_ours(self) -> bool:
        """Whether it carries messages of rsenf."""
        return _is_ours(self.schema)


def topics_of(index: Index) -> dict[str, Topic]:
    """Return the topics of a file, in the order of their channels."""
    names = {number: schema.name for number, schema in index.schemas.items()}
    routes = {n: route_of(c, names.get(c.schema_id, "")) for n, c in index.channels.items()}
    videos = {route.topic for route in routes.values() if route.schema == PACKETS}
    found: dict[str, tuple[str, Extent]] = {}
    stretches: dict[str, list[Stretch]] = {}
    for number, route in routes.items():
        extent = index.extents.get(number)
        if extent is None or (route.is_picture and route.topic in videos):
            continue
        _, others = found.get(route.topic, ("", None))
        found[route.topic] = (route.schema, extent.joined(others))
        stretches.setdefault(route.topic, []).extend(index.stretches[number].all())
    return {
        topic: Topic(topic, schema, *extent[:3], tuple(stretches[topic]), extent.back_ns)
        for topic, (schema, extent) in found.items()
    }


def _is_ours(schema: str) -> bool:
    return schema.startswith(PACKAGE + ".")
