"""Decodes video packets that come without a container, such as recorded ones."""

from __future__ import annotations

from collections import deque
from fractions import Fraction
from typing import Any, NamedTuple, cast

import av

from rsenf.decode.clock import IN_FLIGHT
from rsenf.timebase import NS_PER_S

# Still pictures. FFmpeg's PNG decoder returns garbage after its first one, so each of these gets a
# new decoder.
STILLS = frozenset({"mjpeg", "png", "webp"})
# A larger size comes from invalid data, not from a camera.
LARGEST_PX = 1 << 26
_NEVER = -(1 << 63)
_DECODERS = {"av1": "libdav1d"}  # FFmpeg's own needs hardware


class Decoded(NamedTuple):
    """A picture, and the tag of its packet."""

    picture: av.VideoFrame
    tag: Any


class PacketDecoder:
    """Decodes the packets of one continuous video, with the same result as any exact decoder.

    Parameters
    ----------
    codec : str
        As in :class:`rsenf.messages.VideoPacket`.

    Attributes
    ----------
    contradicts : bool
        Whether the order of the pictures contradicts their packets' times. These are then decoding
        times, not presentation times as claimed.
    """

    def __init__(self, codec: str) -> None:
        self._codec = codec
        self._context = self._open()
        self._in_flight: deque[Any] = deque(maxlen=IN_FLIGHT)  # tags, in decoding order
        self._latest_ns, self._shown_ns = _NEVER, _NEVER
        self._rises = True
        self.contradicts = False

    def decode(self, data: bytes, tag: Any, *, pts_ns: int | None = 0) -> list[Decoded]:
        """Take a packet in decoding order; return the pictures that it completes.

        Parameters
        ----------
        data : bytes
        tag : object
            Returned with the picture.
        pts_ns : int, optional
            Presentation time. None if unknown: tags are then returned in the order of the packets,
            whichever picture comes, as in rule 2 of :class:`FrameClock`.

        Raises
        ------
        av.FFmpegError
            When the packet can't be decoded, or its picture is absurdly large.
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
        """Return the pictures that the decoder still holds. Raises what :meth:`decode` does."""
        return [] if self._codec in STILLS else self._taken(None)

    def __del__(self) -> None:
        # Avoids a deadlock: decoder threads need the GIL to release their packets, while the
        # interpreter waits for these threads to end.
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
        context.copy_opaque = True  # passes each packet's tag to its picture
        # A decoder with several threads delays pictures; a still picture has nothing after it.
        context.thread_type = "NONE" if self._codec in STILLS else "AUTO"
        return context
