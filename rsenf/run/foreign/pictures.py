"""Pictures of another program as they were stored: compressed or raw, from Foxglove and ROS 2.

Foxglove's messages come in Protobuf or JSON, by its published schemas, whose field numbers never
change (https://github.com/foxglove/foxglove-sdk, folders ``schemas/proto`` and
``schemas/jsonschema``). ROS 2 messages come in CDR (Common Data Representation) of either byte
order, which stores the fields in the order of the definition:
https://docs.ros.org/en/rolling/p/sensor_msgs/ and https://docs.ros.org/en/rolling/p/foxglove_msgs/.
These definitions have no versions: a changed one gets a new name.
"""

from __future__ import annotations

import base64
import functools
import json
import struct
from collections.abc import Callable
from typing import Any, NamedTuple

from rsenf.errors import SchemaMismatch
from rsenf.record.topics import FIELDS, IMAGE, VIDEO, foxglove_classes

# Magic numbers of still pictures. Format names are free text in ROS, so they aren't relied on.
_STILLS = ((b"\xff\xd8\xff", "mjpeg"), (b"\x89PNG\r\n\x1a\n", "png"))


class Coded(NamedTuple):
    """A compressed picture.

    ``stamp_ns`` is the time stamp in the message, 0 for none; ``codec`` is FFmpeg's name of it.
    """

    stamp_ns: int
    codec: str
    data: bytes


class RawPicture(NamedTuple):
    """An uncompressed picture, in lines of ``step_bytes`` (0: no padding).

    ``encoding`` is ROS's name of the pixel format; ``big_endian`` applies to 16-bit samples.
    """

    stamp_ns: int
    encoding: str
    width_px: int
    height_px: int
    step_bytes: int
    big_endian: bool
    data: bytes


Picture = Coded | RawPicture


def still_codec(data: bytes) -> str:
    """Return the codec of a still picture by its first bytes; empty if unknown.

    >>> still_codec(b"\\xff\\xd8\\xff\\xe0")
    'mjpeg'
    """
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return "webp"
    return next((codec for begin, codec in _STILLS if data.startswith(begin)), "")


_VIDEO_CODECS = {"h264": "h264", "h265": "hevc", "vp9": "vp9", "av1": "av1"}


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
    return functools.partial(_from_protobuf, schema) if schema in FIELDS else None


def json_reader(schema: str) -> Callable[[bytes], Picture] | None:
    """Return a reader of JSON messages of a schema; None if they hold no picture."""
    return functools.partial(_from_json, schema) if schema in FIELDS else None


def _from_protobuf(schema: str, payload: bytes) -> Picture:
    from google.protobuf.message import DecodeError

    try:
        read = foxglove_classes()[schema].FromString(payload)
    except DecodeError as exc:
        raise SchemaMismatch(f"{len(payload)} bytes that are not a {schema}") from exc
    stamp_ns = read.timestamp.seconds * 1_000_000_000 + read.timestamp.nanos
    return _picture(schema, stamp_ns, {name: getattr(read, name) for name in FIELDS[schema]})


def _from_json(schema: str, payload: bytes) -> Picture:
    try:
        read = json.loads(payload)
        kinds = {name: kind for name, (_, kind) in FIELDS[schema].items() if name != "frame_id"}
        values = {name: _plain(kind, read[name]) for name, kind in kinds.items()}
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
    if schema == VIDEO:
        return coded_video(stamp_ns, read["format"], data)
    if schema == IMAGE:
        return coded_still(stamp_ns, read["format"], data)
    size = read["width"], read["height"], read["step"]
    return RawPicture(stamp_ns, read["encoding"], *size, big_endian=False, data=data)


# Second byte of the 4-byte header: plain CDR and plain CDR 2, big- and little-endian (DDS-XTypes
# 7.6.3.1). The two differ in the alignment of 8-byte numbers, which no picture message has.
_ORDERS = {0: ">", 1: "<", 6: ">", 7: "<"}


class CdrReader:
    """Reads values one after another, each aligned to its size, never beyond the end.

    Parameters
    ----------
    payload : bytes
        A message.

    Raises
    ------
    SchemaMismatch
        Here and from every method, when the bytes are no such value.
    """

    def __init__(self, payload: bytes) -> None:
        if len(payload) < 4 or payload[0] != 0 or payload[1] not in _ORDERS:
            raise SchemaMismatch(f"{len(payload)} bytes that are not CDR")
        self._order = _ORDERS[payload[1]]
        self._body, self._at = memoryview(payload)[4:], 0

    def u8(self) -> int:
        """Read a byte."""
        return self.take(1)[0]

    def u32(self) -> int:
        """Read an unsigned 32-bit integer."""
        return self._four("I")

    def time_ns(self) -> int:
        """Read a ``builtin_interfaces/Time``; return ns."""
        return self._four("i") * 1_000_000_000 + self._four("I")

    def text(self) -> str:
        """Read a string."""
        try:
            return self.sequence().removesuffix(b"\0").decode()
        except UnicodeDecodeError as exc:
            raise SchemaMismatch("a string that is no text") from exc

    def sequence(self) -> bytes:
        """Read a sequence of bytes."""
        return bytes(self.take(self.u32()))

    def take(self, size: int) -> memoryview:
        """Read a number of bytes."""
        end = self._at + size
        if end > len(self._body):
            raise SchemaMismatch(f"{size} bytes wanted where {len(self._body) - self._at} are left")
        taken, self._at = self._body[self._at : end], end
        return taken

    def _four(self, kind: str) -> int:
        self._at += -self._at % 4
        (value,) = struct.unpack(self._order + kind, self.take(4))
        return int(value)


def _image(cdr: CdrReader) -> Picture:
    """Read a ``sensor_msgs/msg/Image``."""
    stamp_ns, _ = cdr.time_ns(), cdr.text()
    height_px, width_px, encoding = cdr.u32(), cdr.u32(), cdr.text()
    big_endian, step = bool(cdr.u8()), cdr.u32()
    return RawPicture(stamp_ns, encoding, width_px, height_px, step, big_endian, cdr.sequence())


def _compressed_image(cdr: CdrReader) -> Picture:
    """Read a ``sensor_msgs/msg/CompressedImage``."""
    stamp_ns, _, name = cdr.time_ns(), cdr.text(), cdr.text()
    return coded_still(stamp_ns, name, cdr.sequence())


def _foxglove_raw(cdr: CdrReader) -> Picture:
    stamp_ns, _ = cdr.time_ns(), cdr.text()
    width_px, height_px, encoding, step = cdr.u32(), cdr.u32(), cdr.text(), cdr.u32()
    return RawPicture(stamp_ns, encoding, width_px, height_px, step, False, cdr.sequence())


def _foxglove_image(cdr: CdrReader) -> Picture:
    stamp_ns, _, data = cdr.time_ns(), cdr.text(), cdr.sequence()
    return coded_still(stamp_ns, cdr.text(), data)


def _foxglove_video(cdr: CdrReader) -> Picture:
    stamp_ns, _, data = cdr.time_ns(), cdr.text(), cdr.sequence()
    return coded_video(stamp_ns, cdr.text(), data)


_MESSAGES: dict[str, Callable[[CdrReader], Picture]] = {
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/CompressedImage": _compressed_image,
    "foxglove_msgs/msg/RawImage": _foxglove_raw,
    "foxglove_msgs/msg/CompressedImage": _foxglove_image,
    "foxglove_msgs/msg/CompressedVideo": _foxglove_video,
}


def cdr_reader(schema: str) -> Callable[[bytes], Picture] | None:
    """Return a reader of CDR messages of a schema; None if they hold no picture."""
    read = _MESSAGES.get(schema)
    return None if read is None else lambda payload: read(CdrReader(payload))
