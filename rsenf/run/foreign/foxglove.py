"""Reads pictures from Foxglove messages, in Protobuf or JSON.

Uses Foxglove's published schemas, whose field numbers never change
(https://github.com/foxglove/foxglove-sdk, folders ``schemas/proto`` and ``schemas/jsonschema``).
"""

from __future__ import annotations

import base64
import functools
import json
from collections.abc import Callable
from typing import Any

from rsenf.errors import SchemaMismatch
from rsenf.run.foreign.picture import Coded, Picture, Raw, still_codec

_VIDEO_CODECS = {"h264": "h264", "h265": "hevc", "vp9": "vp9", "av1": "av1"}
# Field -> number and kind. The stamp is a google.protobuf.Timestamp.
_FIELDS = {
    "foxglove.CompressedVideo": {
        "timestamp": (1, "stamp"), "data": (3, "bytes"), "format": (4, "string"),
    },
    "foxglove.CompressedImage": {
        "timestamp": (1, "stamp"), "data": (2, "bytes"), "format": (3, "string"),
    },
    "foxglove.RawImage": {
        "timestamp": (1, "stamp"), "width": (2, "fixed32"), "height": (3, "fixed32"),
        "encoding": (4, "string"), "step": (5, "fixed32"), "data": (6, "bytes"),
    },
}  # fmt: skip


def coded_video(stamp_ns: int, name: str, data: bytes) -> Coded:
    """Return a picture of a video stream.

    Parameters
    ----------
    stamp_ns : int
        Time stamp of the message, ns.
    name : str
        The message's name of the codec.
    data : bytes

    Raises
    ------
    SchemaMismatch
        When the codec is unknown.
    """
    codec = _VIDEO_CODECS.get(name.lower())
    if codec is None:
        raise SchemaMismatch(f"video in a format that isn't known: {name[:40]!r}")
    return Coded(stamp_ns, codec, data)


def coded_still(stamp_ns: int, name: str, data: bytes) -> Coded:
    """Return a still picture (JPEG, PNG or WebP); parameters as for :func:`coded_video`.

    Raises
    ------
    SchemaMismatch
        When the first bytes show none of these formats.
    """
    codec = still_codec(data)
    if not codec:
        raise SchemaMismatch(f"a picture that is no JPEG, PNG or WebP, by its name {name[:40]!r}")
    return Coded(stamp_ns, codec, data)


def protobuf_reader(schema: str) -> Callable[[bytes], Picture] | None:
    """Return a reader of Protobuf messages of a schema; None if they hold no picture."""
    return functools.partial(_from_protobuf, schema) if schema in _FIELDS else None


def json_reader(schema: str) -> Callable[[bytes], Picture] | None:
    """Return a reader of JSON messages of a schema; None if they hold no picture."""
    return functools.partial(_from_json, schema) if schema in _FIELDS else None


def _from_protobuf(schema: str, payload: bytes) -> Picture:
    from google.protobuf.message import DecodeError

    try:
        read = _classes()[schema].FromString(payload)
    except DecodeError as exc:
        raise SchemaMismatch(f"{len(payload)} bytes that are not a {schema}") from exc
    stamp_ns = read.timestamp.seconds * 1_000_000_000 + read.timestamp.nanos
    return _picture(schema, stamp_ns, {name: getattr(read, name) for name in _FIELDS[schema]})


def _from_json(schema: str, payload: bytes) -> Picture:
    try:
        read = json.loads(payload)
        values = {name: _plain(kind, read[name]) for name, (_, kind) in _FIELDS[schema].items()}
    except (ValueError, TypeError, KeyError, RecursionError) as exc:
        raise SchemaMismatch(f"{len(payload)} bytes that are not a {schema} in JSON") from exc
    return _picture(schema, values["timestamp"], values)


def _plain(kind: str, value: Any) -> Any:
    """Return the value of a JSON field; raises TypeError, KeyError or ValueError if invalid."""
    if kind == "stamp":
        return _number(value["sec"]) * 1_000_000_000 + _number(value["nsec"])
    if kind == "fixed32":
        return _number(value)
    if not isinstance(value, str):
        raise TypeError
    return base64.b64decode(value, validate=True) if kind == "bytes" else value


def _number(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value < 1 << 32:
        raise ValueError
    return value


def _picture(schema: str, stamp_ns: int, read: dict[str, Any]) -> Picture:
    data = bytes(read["data"])
    if schema == "foxglove.CompressedVideo":
        return coded_video(stamp_ns, read["format"], data)
    if schema == "foxglove.CompressedImage":
        return coded_still(stamp_ns, read["format"], data)
    size = read["width"], read["height"], read["step"]
    return Raw(stamp_ns, read["encoding"], *size, big_endian=False, data=data)


@functools.cache
def _classes() -> dict[str, Any]:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    kinds = descriptor_pb2.FieldDescriptorProto
    for schema, fields in _FIELDS.items():
        package, _, name = schema.partition(".")
        file = descriptor_pb2.FileDescriptorProto(
            name=f"{schema}.proto",
            package=package,
            syntax="proto3",
            dependency=[timestamp_pb2.DESCRIPTOR.name],
        )
        message = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            made = message.field.add(name=field, number=number, label=kinds.LABEL_OPTIONAL)
            if kind == "stamp":
                made.type, made.type_name = kinds.TYPE_MESSAGE, ".google.protobuf.Timestamp"
            else:
                made.type = getattr(kinds, f"TYPE_{kind.upper()}")
        pool.AddSerializedFile(file.SerializeToString())
    return {
        schema: message_factory.GetMessageClass(pool.FindMessageTypeByName(schema))
        for schema in _FIELDS
    }
