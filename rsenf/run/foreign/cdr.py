"""The wire form of ROS 2: Common Data Representation, in either order of bytes."""

from __future__ import annotations

import struct

from rsenf.errors import SchemaMismatch

# Second byte of the first four: plain CDR and plain CDR 2, big- and little-endian (XTypes 7.6.3.1).
# What differs between the two, numbers of eight bytes, occurs in no picture.
_ORDERS = {0: ">", 1: "<", 6: ">", 7: "<"}


class CdrReader:
    """Reads values one after another, each aligned to its size, and never beyond the end.

    Parameters
    ----------
    payload : bytes
        A message.

    Raises
    ------
    SchemaMismatch
        Here and from every method, when the bytes aren't what is asked for.
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
        """Read an unsigned number of four bytes."""
        return self._four("I")

    def time_ns(self) -> int:
        """Read a ``builtin_interfaces/Time``."""
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
        """Read so many bytes."""
        end = self._at + size
        if end > len(self._body):
            raise SchemaMismatch(f"{size} bytes wanted where {len(self._body) - self._at} are left")
        taken, self._at = self._body[self._at : end], end
        return taken

    def _four(self, kind: str) -> int:
        self._at += -self._at % 4
        (value,) = struct.unpack(self._order + kind, self.take(4))
        return int(value)
