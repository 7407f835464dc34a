"""Compressed pictures in the form of recordings: Annex B, with parameter sets at key frames."""

from __future__ import annotations

import re

import av
from av.bitstream import BitStreamFilterContext

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
