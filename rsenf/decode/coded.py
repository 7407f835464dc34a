"""Packets of a video to pictures, one by one, wherever the packets come from."""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple, cast

import av

from rsenf.timebase import NS_PER_S

# Every picture for itself. FFmpeg's PNG decoder makes rubbish of all after its first, so each of
# these gets a decoder of its own.
STILLS = frozenset({"mjpeg", "png", "webp"})
# Larger pictures don't come from a camera, but from bytes that are no picture.
LARGEST_PX = 1 << 26
_DECODERS = {"av1": "libdav1d"}  # FFmpeg's own needs hardware


class Decoded(NamedTuple):
    """A picture, and what its packet came with."""

    picture: av.VideoFrame
    tag: Any


class PacketDecoder:
    """Decodes the packets of one stretch of video: bit for bit what any decoder makes of them.

    Parameters
    ----------
    codec : str
        As in :class:`rsenf.messages.VideoPacket`.
    """

    def __init__(self, codec: str) -> None:
        self._codec = codec
        self._context = self._open()

    def decode(self, data: bytes, tag: Any, *, pts_ns: int = 0) -> list[Decoded]:
        """Take a packet in the order of decoding; return the pictures that it completes.

        Parameters
        ----------
        data : bytes
        tag : object
            Comes back with the picture.
        pts_ns : int

        Raises
        ------
        av.FFmpegError
            When it can't be decoded, or its pictures are of an absurd size.
        """
        packet = cast("av.Packet[av.VideoStream]", av.Packet(data))
        packet.pts, packet.time_base = pts_ns, Fraction(1, NS_PER_S)
        packet.opaque = (tag,)  # a new object each time: PyAV keys them by identity
        if self._codec in STILLS:
            self._context = self._open()
        return self._taken(packet)

    def rest(self) -> list[Decoded]:
        """Return the pictures that are still held back. Raises what :meth:`decode` does."""
        return [] if self._codec in STILLS else self._taken(None)

    def __del__(self) -> None:
        # Threads that still decode would wait for the interpreter to let go of their packets, and
        # it for them to end: for ever.
        if self._context.is_open:
            self._context.flush_buffers()

    def _taken(self, packet: av.Packet[av.VideoStream] | None) -> list[Decoded]:
        return [Decoded(p, cast("tuple[Any]", p.opaque)[0]) for p in self._context.decode(packet)]

    def _open(self) -> av.VideoCodecContext:
        name = _DECODERS.get(self._codec, self._codec)
        context = cast(av.VideoCodecContext, av.CodecContext.create(name, "r"))
        context.options = {"max_pixels": str(LARGEST_PX)}
        context.copy_opaque = True  # hands each packet's tag on to its picture
        # With several threads a decoder holds pictures back, of which a still has just one.
        context.thread_type = "NONE" if self._codec in STILLS else "AUTO"
        return context
