"""Several messages of one key in one envelope, as a sender that runs ahead of time sends them.

Each message comes after its length as a varint: the delimited form that the Protobuf libraries of
all languages read and write. The encoding says so, so that nobody takes them for one message.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rsenf.bus.sequence import Envelope
from rsenf.messages.codec import MEDIA_TYPE

SEVERAL = "application/x-protobuf-delimited"
MOST = 64
MOST_LENGTH_BYTES = 5


def joined(items: Sequence[Envelope]) -> Envelope:
    """Put envelopes of one key, encoding and sender into one; a single one stays as it is."""
    if len(items) == 1:
        return items[0]
    payload = b"".join(part for item in items for part in (_length(item.payload), item.payload))
    encoding = items[0].encoding.replace(MEDIA_TYPE, SEVERAL, 1)
    return replace(items[0], encoding=encoding, payload=payload)


def apart(item: Envelope) -> list[Envelope]:
    """Take an envelope apart into those that were joined; one that is broken stays as it is."""
    media, _, schema = item.encoding.partition(";")
    payloads = _split(item.payload) if media == SEVERAL else None
    if payloads is None:
        return [item]
    encoding = f"{MEDIA_TYPE};{schema}"
    return [replace(item, encoding=encoding, payload=payload) for payload in payloads]


def _length(payload: bytes) -> bytes:
    """Length of a message as a varint: seven bits a byte, the lowest first."""
    out, rest = bytearray(), len(payload)
    while rest > 0x7F:
        out.append(rest & 0x7F | 0x80)
        rest >>= 7
    out.append(rest)
    return bytes(out)


def _split(payload: bytes) -> list[bytes] | None:
    """Split at the lengths; None when they don't fill the payload, or nobody would send it."""
    found: list[bytes] = []
    at = 0
    while at < len(payload):
        length = 0
        for place in range(MOST_LENGTH_BYTES):
            if at == len(payload):
                return None
            byte = payload[at]
            at += 1
            length |= (byte & 0x7F) << 7 * place
            if byte < 0x80:
                break
        if at + length > len(payload) or len(found) == MOST:
            return None
        found.append(payload[at : at + length])
        at += length
    return found or None
