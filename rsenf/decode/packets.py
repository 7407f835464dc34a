"""Compressed pictures in the form that recordings want: Annex B, parameter sets at key frames."""

from __future__ import annotations

import re

import av
from av.bitstream import BitStreamFilterContext

# Codec -> bitstream filter that brings its packets into the recorded form.
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
    """Turns a stream's packets into bytes that can be decoded without the container.

    Parameters
    ----------
    stream : av.VideoStream
        The stream they come from; only used here, not later.
    """

    def __init__(self, stream: av.VideoStream) -> None:
        self.codec = stream.codec_context.codec.canonical_name
        name = _FILTERS.get(self.codec, "")
        self._filter = BitStreamFilterContext(name, stream) if name else None
        extra = stream.codec_context.extradata or b""
        self._sets = extra if _START_CODE.match(extra) else b""

    @property
    def recordable(self) -> bool:
        """Whether the codec has a recorded form."""
        return self.codec in _FILTERS

    def data(self, packet: av.Packet[av.VideoStream]) -> bytes:
        """Return the packet in its recorded form; the packet itself is left as it is.

        Empty for one too broken to have one, as the last of a truncated file: its damage shows
        when it is decoded.
        """
        data = bytes(packet)
        if self._filter is None:
            return data
        # The filter consumes what it is given, and the decoder still needs the packet.
        try:
            data = b"".join(bytes(p) for p in self._filter.filter(av.Packet(data)))
        except av.FFmpegError:
            return b""
        return self._with_sets(data) if packet.is_keyframe else data

    def _with_sets(self, data: bytes) -> bytes:
        """Add the last parameter sets to a key frame that comes without (live streams do)."""
        sets, start = parameter_sets(data, self.codec)
        if sets:
            self._sets = sets
            return data
        return data[:start] + self._sets + data[start:]


def parameter_sets(data: bytes, codec: str) -> tuple[bytes, int]:
    """Find the parameter sets before the picture in an Annex B packet.

    Returns
    -------
    sets : bytes
        Their NAL units with start codes, one after the other (ITU-T H.264 and H.265, 7.4.1 and
        7.4.2); empty for none.
    start : int
        Where they belong when missing: after an access unit delimiter, which must come first.
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
            break  # the picture itself: nothing that matters comes after it
    return sets, start


def is_random_access(data: bytes, codec: str) -> bool:
    """Whether an Annex B packet holds a picture that needs no earlier one.

    That is an IDR picture in H.264, any IRAP picture in H.265 (Table 7-1 of each).
    """
    for code in _START_CODE.finditer(data):
        head = data[code.end()] if code.end() < len(data) else 0
        kind = head & 31 if codec == "h264" else head >> 1 & 63
        if kind in range(1, 6) if codec == "h264" else kind < 32:
            return kind == 5 if codec == "h264" else 16 <= kind <= 23
    return False
