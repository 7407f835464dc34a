"""Serialises messages, checks versions, and makes canonical bytes for comparison, or data for JSON.

The schema and version are always explicit: on the bus in the Zenoh encoding
(``application/protobuf;rsenf.RowBlock/1``), in a recording in the MCAP channel.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import math
from collections.abc import Iterable
from typing import Any

from rsenf.errors import SchemaMismatch
from rsenf.messages.header import Header
from rsenf.messages.schema import (
    PACKAGE,
    field_specs,
    file_descriptor,
    from_wire,
    message_classes,
    to_wire,
    twin_class,
)

MEDIA_TYPE = "application/protobuf"
_HEADER_TAG = 0x0A  # field 1, length-delimited; it comes first, as the encoder writes in order


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

    Parameters
    ----------
    encoding : str
        As :func:`encoding_of` makes it.

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
    """Serialise a message deterministically.

    Parameters
    ----------
    msg : message
        Of one of the classes in :mod:`rsenf.messages`.

    Examples
    --------
    >>> from rsenf.messages import Health
    >>> decode(Health, encode(Health(node="rows", messages_in=7))).messages_in
    7
    """
    return serialise(to_wire(msg))


def serialise(wire: Any) -> bytes:
    """Serialise a message's Protobuf twin deterministically."""
    return bytes(wire.SerializeToString(deterministic=True))


def decode(cls: type[Any], payload: bytes) -> Any:
    """Parse a message; arrays are read-only views of the payload.

    Parameters
    ----------
    cls : type
        Class of the message.
    payload : bytes
        What :func:`encode` made.

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


def header_of(payload: bytes) -> Header:
    """Return the header at the beginning of a serialised message.

    Raises
    ------
    SchemaMismatch
        When the message doesn't begin with a header.

    Examples
    --------
    >>> from rsenf.messages import Health, encode
    >>> header_of(encode(Health(header=Header(source="lab/cam1", seq=7)))).seq
    7
    """
    length, at = 0, 1
    if payload[:1] == bytes([_HEADER_TAG]):
        while at < min(len(payload), 6):
            byte = payload[at]
            length |= (byte & 0x7F) << 7 * (at - 1)
            at += 1
            if byte < 0x80:
                if at + length > len(payload):
                    break
                header: Header = decode(Header, payload[at : at + length])
                return header
    raise SchemaMismatch(f"{len(payload)} bytes that don't begin with a header")


def plain(message: Any, longest: int | None = None) -> dict[str, Any]:
    """Return a message's fields as JSON data.

    Times in ns become text (JSON has no exact 64-bit integers), NaN and infinity None, bytes their
    length, and arrays flat lists.

    Parameters
    ----------
    message : object
        Any message.
    longest : int, optional
        Longer arrays are replaced by their length, in words.
    """
    specs = field_specs(type(message))
    return {spec.name: _plain(spec.name, getattr(message, spec.name), longest) for spec in specs}


def _plain(name: str, value: Any, longest: int | None) -> Any:
    if hasattr(value, "VERSION"):
        return plain(value, longest)
    if isinstance(value, bytes):
        return len(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, int) and name.endswith("_ns"):
        return str(value)
    if hasattr(value, "tolist"):
        value = value.ravel().tolist()
    if not isinstance(value, list | tuple):
        return value
    if longest is not None and len(value) > longest:
        return f"{len(value)} values"
    return [_plain(name, one, longest) for one in value]
