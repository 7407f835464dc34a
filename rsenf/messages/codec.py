"""Serialises messages, checks versions, and makes canonical bytes for comparison.

The schema and version are always explicit: on the bus in the Zenoh encoding
(``application/protobuf;rsenf.RowBlock/1``), in a recording in the MCAP channel.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
from collections.abc import Iterable
from typing import Any

from rsenf.errors import SchemaMismatch
from rsenf.messages.schema import (
    PACKAGE,
    file_descriptor,
    from_wire,
    message_classes,
    to_wire,
    twin_class,
)

MEDIA_TYPE = "application/protobuf"


def schema_name(cls: type[Any]) -> str:
    """Return the full schema name of a message class, for example ``rsenf.RowBlock``."""
    return f"{PACKAGE}.{cls.__name__}"


def encoding_of(cls: type[Any]) -> str:
    """Return the Zenoh encoding of a message class: media type, schema name and version.

    Examples
    --------
    >>> from rsenf.messages import RowBlock
    >>> encoding_of(RowBlock), class_for(encoding_of(RowBlock)) is RowBlock
    ('application/protobuf;rsenf.RowBlock/1', True)
    """
    return f"{MEDIA_TYPE};{schema_name(cls)}/{cls.VERSION}"


@functools.lru_cache(maxsize=64)  # doesn't cache errors
def class_for(encoding: str) -> type[Any]:
    """Return the message class of an encoding.

    Raises
    ------
    SchemaMismatch
        For another media type, an unknown schema or another version.
    """
    media, _, rest = encoding.partition(";")
    name, _, version = rest.partition("/")
    cls = message_classes().get(name.removeprefix(PACKAGE + "."))
    if media != MEDIA_TYPE or cls is None:
        raise SchemaMismatch(f"not a message of rsenf: {encoding!r}")
    if version != str(cls.VERSION):
        raise SchemaMismatch(f"{name} version {version}, this program reads {cls.VERSION}")
    return cls


def encode(msg: Any) -> bytes:
    """Serialise a message deterministically."""
    return serialise(to_wire(msg))


def serialise(wire: Any) -> bytes:
    """Serialise a message's Protobuf twin deterministically."""
    return bytes(wire.SerializeToString(deterministic=True))


def decode(cls: type[Any], payload: bytes) -> Any:
    """Parse a message of class ``cls``; arrays are read-only views of the payload.

    Raises
    ------
    SchemaMismatch
        When the bytes don't parse, or an array doesn't fit its shape.
    """
    return from_wire(cls, parse(cls, payload))


def parse(cls: type[Any], payload: bytes) -> Any:
    """Parse a message to its Protobuf twin only, which has fields of the same names.

    Raises
    ------
    SchemaMismatch
        When the bytes don't parse.
    """
    from google.protobuf.message import DecodeError

    try:
        return twin_class(cls).FromString(payload)
    except DecodeError as exc:
        raise SchemaMismatch(f"{len(payload)} bytes that are not a {schema_name(cls)}") from exc


def canonical(msg: Any) -> bytes:
    """Serialise a message without arrival time and run identity: equal content, equal bytes."""
    header = dataclasses.replace(msg.header, run_id="", arrival_time_ns=0)
    return encode(dataclasses.replace(msg, header=header))


def digest(messages: Iterable[Any]) -> str:
    """Return the SHA-256 of the canonical bytes of messages, in their order, as hexadecimal."""
    sha = hashlib.sha256()
    for msg in messages:
        payload = canonical(msg)
        sha.update(len(payload).to_bytes(8, "little"))
        sha.update(payload)
    return sha.hexdigest()


def descriptor_set() -> bytes:
    """Return the published schemas as a serialised ``FileDescriptorSet``, for MCAP."""
    from google.protobuf import descriptor_pb2

    return bytes(
        descriptor_pb2.FileDescriptorSet(file=[file_descriptor()]).SerializeToString(
            deterministic=True
        )
    )
