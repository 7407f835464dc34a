"""Packets of a video to pictures, one by one, wherever the packets come from."""

from __future__ import annotations

from collections import deque
from fractions import Fraction
from typing import Any, NamedTuple, cast

import av

from rsenf.decode.clock import IN_FLIGHT
from rsenf.timebase import NS_PER_S

# Every picture for itself. FFmpeg's PNG decoder makes rubbish of all after its first, so each of
# these gets a decoder of its own.
STILLS = frozenset({"mjpeg", "png", "webp"})
# Larger pictures don't come from a camera, but from bytes that are no picture.
LARGEST_PX = 1 << 26
_NEVER = -(1 << 63)
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

    Attributes
    ----------
    contradicts : bool
        Whether pictures came in an order that contradicts the times of their packets: these are
        times of decoding, though nobody said so.
    """

    def __init__(self, codec: str) -> None:
        self._codec = codec
        self._context = self._open()
        self._in_flight: deque[Any] = deque(maxlen=IN_FLIGHT)  # tags, in the order of decoding
        self._latest_ns, self._shown_ns = _NEVER, _NEVER
        self._rises = True
        self.contradicts = False

    def decode(self, data: bytes, tag: Any, *, pts_ns: int | None = 0) -> list[Decoded]:
        """Take a packet in the order of decoding; return the pictures that it completes.

        Parameters
        ----------
        data : bytes
        tag : object
            Comes back with the picture.
        pts_ns : int, optional
            When it is to be shown. None where that isn't known: tags then come back in the order
            of the packets, whichever of them has the picture, as :class:`FrameClock` has it.

        Raises
        ------
        av.FFmpegError
            When it can't be decoded, or its pictures are of an absurd size.
        """
        packet = cast("av.Packet[av.VideoStream]", av.Packet(data))
        packet.pts, packet.time_base = pts_ns, Fraction(1, NS_PER_S)
        packet.opaque = (tag, pts_ns)  # a new object each time: PyAV keys them by identity
        self._in_flight.append(tag)
        if pts_ns is not None:
            self._rises &= pts_ns >= self._latest_ns
            self._latest_ns = pts_ns
        if self._codec in STILLS:
            self._context = self._open()
        try:
            return self._taken(packet)
        except av.FFmpegError:
            self._in_flight.popleft()
            raise

    def rest(self) -> list[Decoded]:
        """Return the pictures that are still held back. Raises what :meth:`decode` does."""
        return [] if self._codec in STILLS else self._taken(None)

    def __del__(self) -> None:
        # Threads that still decode would wait for the interpreter to let go of their packets, and
        # it for them to end: for ever.
        if self._context.is_open:
            self._context.flush_buffers()

    def _taken(self, packet: av.Packet[av.VideoStream] | None) -> list[Decoded]:
        return [self._tagged(picture) for picture in self._context.decode(packet)]

    def _tagged(self, picture: av.VideoFrame) -> Decoded:
        tag, pts_ns = cast("tuple[Any, int | None]", picture.opaque)
        due = self._in_flight.popleft() if self._in_flight else tag
        if pts_ns is None:
            return Decoded(picture, due)
        self.contradicts |= self._rises and pts_ns < self._shown_ns
        self._shown_ns = pts_ns
        return Decoded(picture, tag)

    def _open(self) -> av.VideoCodecContext:
        name = _DECODERS.get(self._codec, self._codec)
        context = cast(av.VideoCodecContext, av.CodecContext.create(name, "r"))
        context.options = {"max_pixels": str(LARGEST_PX)}
        context.copy_opaque = True  # hands each packet's tag on to its picture
        # With several threads a decoder holds pictures back, of which a still has just one.
        context.thread_type = "NONE" if self._codec in STILLS else "AUTO"
        return context
