"""Video in Foxglove's schemas, so that common players show the recorded pictures.

The messages are ``foxglove.CompressedVideo`` and ``foxglove.CompressedImage`` as published in
https://github.com/foxglove/foxglove-sdk, folder ``schemas/proto``, in their first four fields.
Foxglove can't play video with B frames; such a stream is recorded nevertheless, packet by packet in
decoding order.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from rsenf.errors import SchemaMismatch

VIDEO = "foxglove.CompressedVideo"
IMAGE = "foxglove.CompressedImage"
# Field numbers, which differ between the two.
_FIELDS = {
    VIDEO: {"timestamp": 1, "frame_id": 2, "data": 3, "format": 4},
    IMAGE: {"timestamp": 1, "frame_id": 4, "data": 2, "format": 3},
}
_FORMATS = {
    "h264": (VIDEO, "h264"),
    "hevc": (VIDEO, "h265"),
    "vp9": (VIDEO, "vp9"),
    "av1": (VIDEO, "av1"),
    "mjpeg": (IMAGE, "jpeg"),
    "png": (IMAGE, "png"),
    "webp": (IMAGE, "webp"),
}


class Picture(NamedTuple):
    """A packet in one of Foxglove's schemas."""

    schema: str
    payload: bytes


def knows(schema: str) -> bool:
    """Whether a schema is one of the two."""
    return schema in _FIELDS


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
    made = _classes()[schema](frame_id=packet.header.source, data=packet.data, format=name)
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
        return bytes(_classes()[schema].FromString(payload).data)
    except DecodeError as exc:
        raise SchemaMismatch(f"{len(payload)} bytes that are not a {schema}") from exc


def descriptor_set(schema: str) -> bytes:
    """Describe one of the two schemas, as a serialised ``FileDescriptorSet``, for MCAP."""
    from google.protobuf import descriptor_pb2

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
    types = {"timestamp": kinds.TYPE_MESSAGE, "data": kinds.TYPE_BYTES}
    for field, number in _FIELDS[schema].items():
        made = described.field.add(
            name=field,
            number=number,
            label=kinds.LABEL_OPTIONAL,
            type=types.get(field, kinds.TYPE_STRING),
        )
        if field == "timestamp":
            made.type_name = ".google.protobuf.Timestamp"
    return out


@functools.cache
def _classes() -> dict[str, Any]:
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for described in (_timestamp_file(), *map(_file, _FIELDS)):
        pool.AddSerializedFile(described.SerializeToString())
    return {
        schema: message_factory.GetMessageClass(pool.FindMessageTypeByName(schema))
        for schema in _FIELDS
    }
