"""Decodes only the header of a serialised message."""

from __future__ import annotations

from rsenf.errors import SchemaMismatch
from rsenf.messages import Header, decode

_HEADER_TAG = 0x0A  # field 1, length-delimited; it comes first, as the encoder writes in order


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
