"""The container of a video: opened, checked for truncation, and described before decoding.

FFmpeg reads a truncated Matroska or AVI file to its end without an error, and reports only
"invalid data" for an MP4 whose index was never written. The lengths in a file's outermost structure
show both.
"""

from __future__ import annotations

import itertools
import os
import struct
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import av
from av.container import InputContainer
from av.stream import Disposition

from rsenf.decode.packets import PacketWriter
from rsenf.decode.source import StreamInfo
from rsenf.errors import InputError, UsageError
from rsenf.messages import RateBasis
from rsenf.timebase import since_1970_ns

_EBML, _SEGMENT = 0x1A45DFA3, 0x18538067
# Boxes that pictures are read from. Any other one may be incomplete, or be junk appended by a
# camera, without any frame missing.
_MP4_PICTURES = (b"mdat", b"moov", b"moof")
_MP4_FIRST = (*_MP4_PICTURES, b"ftyp", b"wide", b"free", b"skip", b"pnot", b"styp")
# Length field of a RIFF file that was not finished.
_RIFF_OPEN = (0, 0xFFFFFFFF)


def missing_bytes(path: Path) -> int:
    """Return how many bytes are missing at the end of a file; 0 if none, or if unknown.

    Knows MP4 and QuickTime boxes (ISO/IEC 14496-12, 4.2), Matroska and WebM elements (RFC 8794),
    and RIFF chunks (AVI).
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[4:8] in _MP4_FIRST:
            ends = (end for kind, end in _boxes(file, size) if kind in _MP4_PICTURES)
            return max(0, max(ends, default=0) - size)
        if head[:4] == _EBML.to_bytes(4):
            return max(0, _segment_end(file, size) - size)
        if head[:4] == b"RIFF":
            return max(0, _riff_end(file, size) - size)
    return 0


def lacks_index(path: Path) -> bool:
    """Whether a file is an MP4 or QuickTime file without its index (``moov``)."""
    with path.open("rb") as file:
        if file.read(8)[4:8] not in _MP4_FIRST:
            return False
        return all(kind != b"moov" for kind, _ in _boxes(file, path.stat().st_size))


def _boxes(file: BinaryIO, size: int) -> list[tuple[bytes, int]]:
    """Return type and end offset of each outermost box."""
    found: list[tuple[bytes, int]] = []
    start = 0
    while start + 8 <= size:
        file.seek(start)
        length, kind = struct.unpack(">I4s", file.read(8))
        if length == 1:
            length = int.from_bytes(file.read(8))
        elif length == 0:
            length = size - start  # to the end of the file
        if length < 8:
            break
        start += length
        found.append((kind, start))
    return found


def _segment_end(file: BinaryIO, size: int) -> int:
    """Return the end offset of a Matroska file's segment; 0 if its length is unknown."""
    file.seek(0)
    for _ in range(4):  # the header, perhaps padding, the segment
        kind = _vint(file, keep_marker=True)
        length = _vint(file)
        if length is None:
            return 0
        if kind == _SEGMENT:
            return file.tell() + length
        file.seek(min(length, size), os.SEEK_CUR)
    return 0


def _vint(file: BinaryIO, *, keep_marker: bool = False) -> int | None:
    """Read an EBML variable-size integer; None for "unknown" and at the end of the file."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    extra = 8 - first[0].bit_length()
    rest = file.read(extra)
    bits = 7 * (extra + 1)
    value = int.from_bytes(first + rest)
    if keep_marker:
        return value
    value &= (1 << bits) - 1
    return None if value == (1 << bits) - 1 else value


def _riff_end(file: BinaryIO, size: int) -> int:
    """Return the end offset of the last finished RIFF chunk: long AVI files have several."""
    end = 0
    while end + 8 <= size:
        file.seek(end)
        kind, length = struct.unpack("<4sI", file.read(8))
        if kind != b"RIFF" or length in _RIFF_OPEN:
            break
        end += 8 + length
    return end


# AVFMT_NOTIMESTAMPS: a raw elementary stream. FFmpeg has invented the times of its packets.
_NO_TIMES = 0x0080
# Formats that number their pictures and declare a rate.
_NUMBERED = {"avi", "yuv4mpegpipe"}
# JPEG pictures over HTTP have no times: FFmpeg numbers them at a rate of its own.
_UNTIMED = "mpjpeg"
# A stream's duration is in its ticks, a container's in microseconds.
_MICROSECOND = Fraction(1, 1_000_000)


def fraction(value: Fraction | None) -> Fraction:
    """Return a rate or time base as a Fraction; 0 if unknown."""
    return Fraction(value.numerator, value.denominator) if value else Fraction(0)


def describe(
    container: InputContainer,
    stream: av.VideoStream,
    writer: PacketWriter,
    given_rate_hz: float | None = None,
) -> StreamInfo:
    """Describe a stream, except for its rotation, which only a decoded frame tells.

    Parameters
    ----------
    container, stream : av.container.InputContainer, av.VideoStream
    writer : PacketWriter
        Tells whether packets can be recorded.
    given_rate_hz : float, optional
        Frame rate given by the user, in place of the time stamps.
    """
    context, basis = stream.codec_context, rate_basis(container, stream)
    # For a stream without a declared rate, guessed_rate is FFmpeg's assumption.
    rate = fraction(None if basis is RateBasis.ASSUMED else stream.guessed_rate)
    length_s = duration_s(container, stream)
    return StreamInfo(
        codec=writer.codec,
        width_px=context.width,
        height_px=context.height,
        declared_rate_hz=float(rate),
        rate_basis=RateBasis.GIVEN if given_rate_hz else basis,
        duration_s=length_s,
        frame_count=stream.frames or (round(length_s * rate) if length_s and rate else None),
        camera_start_ns=_creation_ns({**container.metadata, **stream.metadata}),
        packets_recordable=writer.recordable,
        packets_reason=_reason(writer, has_b_frames=context.has_b_frames),
    )


def rate_basis(container: InputContainer, stream: av.VideoStream) -> RateBasis:
    """Return where the frame times of a stream come from."""
    if container.format.name == _UNTIMED:
        return RateBasis.ASSUMED
    if container.format.flags & _NO_TIMES:
        # The codec's headers may hold the rate.
        return RateBasis.DECLARED if stream.codec_context.framerate else RateBasis.ASSUMED
    numbered = container.format.name in _NUMBERED
    return RateBasis.DECLARED if numbered else RateBasis.STAMPED


def duration_s(container: InputContainer, stream: av.VideoStream) -> float | None:
    """Return the duration that a stream declares, or else its container; None for neither."""
    if stream.duration:
        return float(stream.duration * fraction(stream.time_base))
    return float(container.duration * _MICROSECOND) if container.duration else None


def _creation_ns(metadata: dict[str, str]) -> int:
    """Return ``creation_time`` in ns since 1970 (UTC); 0 if missing, unreadable or never set."""
    try:
        created = datetime.fromisoformat(metadata.get("creation_time", ""))
    except ValueError:
        return 0
    # Cameras without a clock write the epoch of MP4 (1904) or of Unix.
    return max(0, since_1970_ns(created))


def _reason(writer: PacketWriter, *, has_b_frames: bool) -> str:
    if writer.reason:
        return writer.reason
    if has_b_frames and writer.codec in ("h264", "hevc"):
        return "it has B frames: packets are in decoding order, which some players don't show"
    return ""


# Concatenated JPEG pictures, which FFmpeg opens as a slide show unless told the format.
_JPEGS, _MOTION_JPEG = "jpeg_pipe", "mjpeg"
# Formats that FFmpeg opens though they are no recordings: text as pictures, lists of files.
_NOT_VIDEO = {"tty", "bin", "xbin", "adf", "idf", "concat", "hls", "dash", "sdp", "image2"}
HINT = "give a video file that plays, such as mp4, mov, mkv, webm or avi"


def open_container(path: Path) -> InputContainer:
    """Open a video file.

    Raises
    ------
    UsageError
        When it can't be read.
    InputError
        When it is no video.
    """
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as exc:
        reason = (exc.strerror or "no access").lower()
        raise UsageError(f"{path} can't be read: {reason}", "check the path of the video") from exc
    if empty:
        raise InputError(f"{path} is empty", HINT)
    try:
        container = _opened(path)
        packets = itertools.islice(container.demux(), 2) if container.format.name == _JPEGS else ()
        if sum(1 for packet in packets if packet.size) > 1:  # a video, not a photograph
            container.close()
            container = _opened(path, _MOTION_JPEG)
    except av.FFmpegError as exc:
        if lacks_index(path):
            raise InputError(
                f"{path} was never finished: its index (moov) is missing",
                "the camera stopped before closing it; a repair tool may rebuild the index",
            ) from exc
        raise InputError(f"{path} is not a video that can be read", HINT) from exc
    names = set(container.format.name.split(","))
    if names & _NOT_VIDEO or container.format.name.endswith("_pipe"):
        raise InputError(f"{path} is not a video: it reads as {container.format.long_name}", HINT)
    return container


def _opened(path: Path, form: str | None = None) -> InputContainer:
    # An absolute path, so that no file name is taken for a protocol.
    return av.open(str(path.absolute()), "r", form, metadata_errors="replace")


def video_stream(container: InputContainer, path: Path) -> av.VideoStream:
    """Return the main video stream; the cover picture of an audio file is none.

    Parameters
    ----------
    container : av.container.InputContainer
    path : Path
        For messages.

    Raises
    ------
    InputError
        When there is none, or no decoder for it.
    """
    streams = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
    if not streams:
        only = ", only sound" if container.streams.audio else ""
        raise InputError(f"{path} has no video{only}", HINT)
    best = container.streams.best("video")
    stream = best if best in streams else streams[0]
    assert isinstance(stream, av.VideoStream)
    if stream.codec_context is None:
        raise InputError(f"{path}: no decoder for its video stream", HINT)
    return stream
