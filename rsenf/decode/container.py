"""Metadata of a video file: format, device, creation time, and statistics of its time stamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer

from rsenf.decode.describe import duration_s, fraction, rate_basis
from rsenf.decode.file import open_container, video_stream
from rsenf.errors import InputError
from rsenf.messages import RateBasis

# Metadata keys for each fact: QuickTime's and Android's names beside the plain one.
_SAID = {
    "creation_time": ("creation_time", "com.apple.quicktime.creationdate", "date"),
    "encoder": ("encoder", "com.apple.quicktime.software", "software", "firmware"),
    "make": ("make", "com.apple.quicktime.make", "com.android.manufacturer", "manufacturer"),
    "model": ("model", "com.apple.quicktime.model", "com.android.model"),
}


@dataclass(frozen=True, kw_only=True)
class ContainerFacts:
    """Metadata of a video file. Anyone could have written or changed them.

    Attributes
    ----------
    format, codec, pixel_format : str
        FFmpeg's names.
    width_px, height_px : int
    bit_rate_bps : int or None
        Of the whole file.
    duration_s : float or None
    declared_rate_hz : float or None
    rate_basis : str
        Source of the frame times, as in RateBasis; empty if frames have time stamps.
    stamped_frames : int
        Number of frames with a time stamp.
    shortest_s, median_s, longest_s : float or None
        Intervals between successive time stamps.
    creation_time, encoder, make, model : str
        Empty if not in the file.
    """

    format: str
    codec: str
    pixel_format: str
    width_px: int
    height_px: int
    bit_rate_bps: int | None
    duration_s: float | None
    declared_rate_hz: float | None
    rate_basis: str
    stamped_frames: int
    shortest_s: float | None
    median_s: float | None
    longest_s: float | None
    creation_time: str
    encoder: str
    make: str
    model: str


def container_facts(path: Path) -> ContainerFacts | None:
    """Read the metadata of a file; None if it is no video. Reads all packets, decodes none."""
    try:
        with open_container(path) as container:
            return _facts(container, video_stream(container, path))
    except InputError:
        return None


def _facts(container: InputContainer, stream: av.VideoStream) -> ContainerFacts:
    basis, context = rate_basis(container, stream), stream.codec_context
    rate_hz = float(fraction(None if basis is RateBasis.ASSUMED else stream.guessed_rate))
    ticks = np.sort(list(_stamps(container, stream)) if not basis else [])
    gaps_s = np.diff(ticks) * float(fraction(stream.time_base))
    shortest_s, median_s, longest_s = (
        map(float, np.quantile(gaps_s, (0.0, 0.5, 1.0))) if gaps_s.size else (None, None, None)
    )
    return ContainerFacts(
        format=container.format.long_name,
        codec=" ".join(filter(None, [context.name, context.profile])),
        pixel_format=context.pix_fmt or "",
        width_px=context.width,
        height_px=context.height,
        bit_rate_bps=container.bit_rate or None,
        duration_s=duration_s(container, stream),
        declared_rate_hz=rate_hz or None,
        rate_basis=str(basis),
        stamped_frames=ticks.size,
        shortest_s=shortest_s,
        median_s=median_s,
        longest_s=longest_s,
        **_said(container, stream),
    )


def _stamps(container: InputContainer, stream: av.VideoStream) -> Iterator[int]:
    """Yield presentation time stamps in ticks, as far as the file can be read."""
    try:
        for packet in container.demux(stream):
            if packet.pts is not None:
                yield packet.pts
    except av.FFmpegError:
        return


def _said(container: InputContainer, stream: av.VideoStream) -> dict[str, str]:
    """Return metadata by plain names; both values where the file and the stream differ."""
    metadata = [{k.lower(): v for k, v in of.metadata.items()} for of in (container, stream)]
    return {
        name: "; ".join(dict.fromkeys(one[key] for key in keys for one in metadata if key in one))
        for name, keys in _SAID.items()
    }
