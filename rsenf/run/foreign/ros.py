"""Reads pictures from ROS 2 messages, in CDR (Common Data Representation) of either byte order.

CDR stores the fields of a message in the order of its definition:
https://docs.ros.org/en/rolling/p/sensor_msgs/ and https://docs.ros.org/en/rolling/p/foxglove_msgs/.
These definitions have no versions: a changed one gets a new name.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from rsenf.errors import SchemaMismatch
from rsenf.run.foreign.foxglove import coded_still, coded_video
from rsenf.run.foreign.picture import Picture, Raw

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
    return Raw(stamp_ns, encoding, width_px, height_px, step, big_endian, cdr.sequence())


def _compressed_image(cdr: CdrReader) -> Picture:
    """Read a ``sensor_msgs/msg/CompressedImage``."""
    stamp_ns, _, name = cdr.time_ns(), cdr.text(), cdr.text()
    return coded_still(stamp_ns, name, cdr.sequence())


def _foxglove_raw(cdr: CdrReader) -> Picture:
    stamp_ns, _ = cdr.time_ns(), cdr.text()
    width_px, height_px, encoding, step = cdr.u32(), cdr.u32(), cdr.text(), cdr.u32()
    return Raw(stamp_ns, encoding, width_px, height_px, step, False, cdr.sequence())


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


def reader_of(schema: str) -> Callable[[bytes], Picture] | None:
    """Return a reader of CDR messages of a schema; None if they hold no picture."""
    read = _MESSAGES.get(schema)
    return None if read is None else lambda payload: read(CdrReader(payload))
