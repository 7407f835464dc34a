"""Describes a video stream from its container, before anything is decoded."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from fractions import Fraction

import av
from av.container import InputContainer

from rsenf.decode.packets import PacketWriter
from rsenf.decode.spec import StreamInfo
from rsenf.messages import RateBasis

# AVFMT_NOTIMESTAMPS: a raw elementary stream. FFmpeg has invented the times of its packets.
_NO_TIMES = 0x0080
# Formats that number their pictures and declare a rate.
_NUMBERED = {"avi", "yuv4mpegpipe"}
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
        time_step_s=float(fraction(stream.time_base)),
        duration_s=length_s,
        frame_count=stream.frames or (round(length_s * rate) if length_s and rate else None),
        camera_start_ns=_creation_ns({**container.metadata, **stream.metadata}),
        has_b_frames=context.has_b_frames,
        packets_recordable=writer.recordable,
        packets_reason=_reason(writer, has_b_frames=context.has_b_frames),
    )


def rate_basis(container: InputContainer, stream: av.VideoStream) -> RateBasis:
    """Return where the frame times of a stream come from."""
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
    created = created if created.tzinfo else created.replace(tzinfo=UTC)
    since = created - datetime(1970, 1, 1, tzinfo=UTC)
    # Cameras without a clock write the epoch of MP4 (1904) or of Unix.
    return max(0, since // timedelta(microseconds=1) * 1000)


def _reason(writer: PacketWriter, *, has_b_frames: bool) -> str:
    if not writer.recordable:
        return f"{writer.codec} has no recorded form"
    if has_b_frames and writer.codec in ("h264", "hevc"):
        return "it has B frames: packets are in decoding order, which some players don't show"
    return ""
