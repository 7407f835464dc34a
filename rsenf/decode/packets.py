"""Compressed pictures outside a container: made for recordings, timed, and decoded.

They are kept as Annex B, with parameter sets at key frames. A presentation time is exact where the
stream has one, otherwise counted as inferred.
"""

from __future__ import annotations

import re
from collections import deque
from fractions import Fraction
from typing import Any, NamedTuple, cast

import av
from av.bitstream import BitStreamFilterContext

from rsenf.errors import UsageError
from rsenf.timebase import NS_PER_S, pts_to_ns

# Codec -> bitstream filter that converts its packets to the recorded form.
_FILTERS = {
    "h264": "h264_mp4toannexb",
    "hevc": "hevc_mp4toannexb",
    "vp8": "",
    "vp9": "",
    "av1": "",
    "mjpeg": "",
}

_START_CODE = re.compile(rb"\x00?\x00\x00\x01")


class PacketWriter:
    """Converts a stream's packets to bytes that can be decoded without the container.

    Parameters
    ----------
    stream : av.VideoStream
        Stream of the packets; not used after construction.

    Attributes
    ----------
    reason : str
        Why the packets have no recorded form; empty if they have.
    """

    def __init__(self, stream: av.VideoStream) -> None:
        self.codec = stream.codec_context.codec.canonical_name
        name = _FILTERS.get(self.codec, "")
        self.reason = "" if self.codec in _FILTERS else f"{self.codec} has no recorded form"
        try:
            self._filter = BitStreamFilterContext(name, stream) if name else None
        except av.FFmpegError:
            self._filter, self.reason = None, "the stream's parameters are damaged"
        extra = stream.codec_context.extradata or b""
        self._sets = extra if _START_CODE.match(extra) else b""

    @property
    def recordable(self) -> bool:
        """Whether the packets have a recorded form."""
        return not self.reason

    def data(self, packet: av.Packet[av.VideoStream]) -> bytes:
        """Return the packet in its recorded form; the packet itself stays unchanged.

        Empty for a damaged packet, such as the last of a truncated file: decoding reports it.
        """
        data = bytes(packet)
        if self._filter is None:
            return data
        # The filter consumes its input, and the decoder still needs the packet.
        try:
            data = b"".join(bytes(p) for p in self._filter.filter(av.Packet(data)))
        except av.FFmpegError:
            return b""
        return self._with_sets(data) if packet.is_keyframe else data

    def _with_sets(self, data: bytes) -> bytes:
        """Add the last parameter sets to a key frame without any (as in live streams)."""
        sets, start = parameter_sets(data, self.codec)
        if sets:
            self._sets = sets
            return data
        return data[:start] + self._sets + data[start:]


def parameter_sets(data: bytes, codec: str) -> tuple[bytes, int]:
    """Find the parameter sets before the picture in an Annex B packet.

    Parameters
    ----------
    data : bytes
        An access unit with start codes.
    codec : str
        'h264' or 'hevc'.

    Returns
    -------
    sets : bytes
        Their NAL units with start codes, concatenated (ITU-T H.264 and H.265, 7.4.1 and 7.4.2);
        empty for none.
    start : int
        Where to insert them if missing: after an access unit delimiter, which must come first.

    Examples
    --------
    >>> parameter_sets(b"\\0\\0\\1\\x67ab\\0\\0\\1\\x68c\\0\\0\\1\\x65picture", "h264")
    (b'\\x00\\x00\\x01gab\\x00\\x00\\x01hc', 0)
    """
    wanted, delimiter = ((7, 8), 9) if codec == "h264" else ((32, 33, 34), 35)
    sets, start = b"", 0
    kind, begin = -1, 0
    for code in _START_CODE.finditer(data):
        if kind in wanted:
            sets += data[begin : code.start()]
        elif kind == delimiter:
            start = code.start()
        begin = code.start()
        head = data[code.end()] if code.end() < len(data) else 0
        kind = head & 31 if codec == "h264" else head >> 1 & 63
        if kind in range(1, 6) if codec == "h264" else kind < 32:
            break  # the picture itself
    return sets, start


def is_random_access(data: bytes, codec: str) -> bool:
    """Whether decoding can start at an Annex B packet.

    True for an IDR picture of H.264 or any IRAP picture of H.265 (Table 7-1 of each).

    Parameters
    ----------
    data : bytes
    codec : str
        'h264' or 'hevc'.

    Examples
    --------
    >>> is_random_access(b"\\0\\0\\1\\x65", "h264"), is_random_access(b"\\0\\0\\1\\x41", "h264")
    (True, False)
    """
    for code in _START_CODE.finditer(data):
        head = data[code.end()] if code.end() < len(data) else 0
        kind = head & 31 if codec == "h264" else head >> 1 & 63
        if kind in range(1, 6) if codec == "h264" else kind < 32:
            return kind == 5 if codec == "h264" else 16 <= kind <= 23
    return False


# More packets than any decoder holds before it returns the first of their frames.
IN_FLIGHT = 256
# FFmpeg's assumption, too, for a stream without a declared rate.
ASSUMED_RATE_HZ = Fraction(25)


class FrameClock:
    """Presentation times of the frames of one stream.

    1. A frame has the presentation time stamp (PTS) that the container gave its packet.
    2. Without PTS, the n-th frame shown gets the n-th decoding time stamp (DTS), which rises from
       packet to packet, plus the last known difference of PTS and DTS. This is exact for AVI, whose
       packets are numbered at a constant rate.
    3. A raw elementary stream has no time stamps: each frame follows the one before by one period
       of the frame rate.

    FFmpeg's own guess (``genpts``) must be off: it gets the order of B frames in AVI wrong.

    Parameters
    ----------
    time_base : Fraction
        Seconds per tick.
    rate_hz : Fraction
        Frame rate, for rule 3; 0 if unknown.

    Attributes
    ----------
    from_order, from_rate : int
        Frames timed by rules 2 and 3.
    """

    def __init__(self, time_base: Fraction, rate_hz: Fraction) -> None:
        self._time_base = time_base
        self._period_s = 1 / (rate_hz or ASSUMED_RATE_HZ)
        self._decode_times: deque[int] = deque(maxlen=IN_FLIGHT)
        self._delay = 0
        self._anchor_ns = 0  # last time by rule 1 or 2
        self._since_anchor = -1
        self._packets = 0
        self.from_order = 0
        self.from_rate = 0

    def expect(self, packet: av.Packet[av.VideoStream]) -> int:
        """Note a packet that is passed to the decoder; return its PTS, or else DTS, in ns."""
        if packet.dts is not None:
            self._decode_times.append(packet.dts)
        number, self._packets = self._packets, self._packets + 1
        ticks = packet.dts if packet.pts is None else packet.pts
        if ticks is None:
            return pts_to_ns(number, self._period_s)
        return pts_to_ns(ticks, self._time_base)

    def forget(self) -> None:
        """Note that a packet could not be decoded, so that no frame of it will come."""
        if self._decode_times:
            self._decode_times.popleft()
        else:
            self._since_anchor += 1

    def time_ns(self, pts: int | None) -> int:
        """Return the time of the next frame shown, in ns, from its PTS if it has one."""
        decode_time = self._decode_times.popleft() if self._decode_times else None
        if pts is not None:
            if decode_time is not None:
                self._delay = pts - decode_time
            return self._anchor(pts)
        if decode_time is not None:
            self.from_order += 1
            return self._anchor(decode_time + self._delay)
        self.from_rate += 1
        self._since_anchor += 1
        return self._anchor_ns + pts_to_ns(self._since_anchor, self._period_s)

    def _anchor(self, pts: int) -> int:
        self._anchor_ns, self._since_anchor = pts_to_ns(pts, self._time_base), 0
        return self._anchor_ns


# Still pictures. FFmpeg's PNG decoder returns garbage after its first one, so each of these gets a
# new decoder.
STILLS = frozenset({"mjpeg", "png", "webp"})
# A larger size comes from invalid data, not from a camera.
LARGEST_PX = 1 << 26
_NEVER = -(1 << 63)
_DECODERS = {"av1": "libdav1d"}  # FFmpeg's own needs hardware


class TaggedPicture(NamedTuple):
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

    def decode(self, data: bytes, tag: Any, *, pts_ns: int | None = 0) -> list[TaggedPicture]:
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

    def rest(self) -> list[TaggedPicture]:
        """Return the pictures that the decoder still holds. Raises what :meth:`decode` does."""
        return [] if self._codec in STILLS else self._taken(None)

    def __del__(self) -> None:
        # Avoids a deadlock: decoder threads need the GIL to release their packets, while the
        # interpreter waits for these threads to end.
        context = getattr(self, "_context", None)  # none where there is no such decoder
        if context is not None and context.is_open:
            context.flush_buffers()

    def _taken(self, packet: av.Packet[av.VideoStream] | None) -> list[TaggedPicture]:
        return [self._tagged(picture) for picture in self._context.decode(packet)]

    def _tagged(self, picture: av.VideoFrame) -> TaggedPicture:
        tag, pts_ns = cast("tuple[Any, int | None]", picture.opaque)
        due = self._in_flight.popleft() if self._in_flight else tag
        if pts_ns is None:
            return TaggedPicture(picture, due)
        self.contradicts |= self._rises and pts_ns < self._shown_ns
        self._shown_ns = pts_ns
        return TaggedPicture(picture, tag)

    def _open(self) -> av.VideoCodecContext:
        name = _DECODERS.get(self._codec, self._codec)
        try:
            context = cast(av.VideoCodecContext, av.CodecContext.create(name, "r"))
        except ValueError:  # av.codec.codec.UnknownCodecError
            raise UsageError(f"no decoder here for video in {name!r}") from None
        context.options = {"max_pixels": str(LARGEST_PX)}
        context.copy_opaque = True  # passes each packet's tag to its picture
        # A decoder with several threads delays pictures; a still picture has nothing after it.
        context.thread_type = "NONE" if self._codec in STILLS else "AUTO"
        return context
