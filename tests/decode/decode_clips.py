"""Small real clips for the tests of decoding, and what they must decode to."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from rsenf.decode import Item, SourceSpec, VideoSource, open_source
from rsenf.messages import Frame, VideoPacket

NTSC = Fraction(30000, 1001)
# Encoder -> options that make it keep every bit.
LOSSLESS = {
    "libx264": {"qp": "0", "g": "8", "sc_threshold": "0"},
    "libx265": {"x265-params": "lossless=1:log-level=none:keyint=8"},
    "libvpx-vp9": {"lossless": "1", "g": "8"},
    "ffv1": {},
    "rawvideo": {},
}
# Encoder and container, for all that rsenf promises to read.
CONTAINERS = [
    *(("libx264", suffix) for suffix in ("mp4", "mov", "mkv", "avi")),
    *(("libx265", suffix) for suffix in ("mp4", "mov", "mkv")),
    *(("libvpx-vp9", suffix) for suffix in ("webm", "mkv", "mp4")),
    *(("mjpeg", suffix) for suffix in ("avi", "mov", "mkv", "mp4")),
    ("ffv1", "avi"),
]


def pictures(
    count: int, height_px: int = 48, width_px: int = 64, *, seed: int = 1, top: int = 255
) -> list[NDArray[Any]]:
    """Moving stripes with noise, over the whole range of levels from 0 to ``top``."""
    rng = np.random.default_rng(seed)
    rows = np.arange(height_px)[:, None]
    dtype = np.uint8 if top < 256 else np.uint16
    made = []
    for n in range(count):
        stripes = top / 2 * (1 + np.sin(2 * np.pi * (rows / 20 + n / 7)))
        noisy = stripes + rng.normal(0, top / 40, (height_px, width_px))
        made.append(noisy.clip(0, top).astype(dtype))
    return made


def _as_frame(luma: NDArray[Any], pix_fmt: str) -> av.VideoFrame:
    """Put luma into plane 0 as it is: a conversion could rescale it."""
    height_px, width_px = luma.shape
    frame = av.VideoFrame(width_px, height_px, pix_fmt)
    for plane in frame.planes[1:]:
        memory = np.frombuffer(plane, np.uint8)
        memory[:] = 128
    plane = frame.planes[0]
    memory = np.frombuffer(plane, np.uint8)
    lines = memory.reshape(-1, plane.line_size).view(luma.dtype)
    lines[:height_px, :width_px] = luma
    return frame


def make_clip(
    path: Path,
    lumas: Sequence[NDArray[Any]],
    encoder: str = "libx264",
    *,
    pix_fmt: str = "",
    rate_hz: Fraction = NTSC,
    ticks: Sequence[int] = (),
    time_base: Fraction | None = None,
    options: dict[str, str] | None = None,
    container_options: dict[str, str] | None = None,
    container_format: str | None = None,
    metadata: dict[str, str] | None = None,
    to_frame: Callable[[NDArray[Any], str], av.VideoFrame] = _as_frame,
) -> Path:
    """Write a clip, one frame a period or at the given ticks, without loss where possible."""
    pix_fmt = pix_fmt or ("yuvj420p" if encoder == "mjpeg" else "yuv420p")
    with av.open(
        str(path), "w", format=container_format, options=container_options or {}
    ) as container:
        container.metadata.update(metadata or {})
        stream = container.add_stream(encoder, rate=rate_hz)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = lumas[0].shape
        stream.pix_fmt = pix_fmt
        stream.options = {**LOSSLESS.get(encoder, {}), **(options or {})}
        stream.codec_context.time_base = time_base or 1 / rate_hz
        for number, luma in enumerate(lumas):
            frame = to_frame(luma, pix_fmt)
            frame.pts = ticks[number] if ticks else number
            frame.time_base = stream.codec_context.time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def make_sound(path: Path) -> Path:
    """Write a file with a second of silence and no video."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=48000)
        assert isinstance(stream, av.AudioStream)
        for start in range(0, 48000, 1024):
            frame = av.AudioFrame(format="fltp", layout="stereo", samples=1024)
            for plane in frame.planes:
                plane.update(bytes(plane.buffer_size))
            frame.sample_rate, frame.pts = 48000, start
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def cut_short(path: Path, to: Path, share: float = 0.6) -> Path:
    """Write the first part of a file, as a full card or an empty battery leaves it."""
    whole = path.read_bytes()
    to.write_bytes(whole[: int(len(whole) * share)])
    return to


def source_of(path: Path, **spec: Any) -> VideoSource:
    """Open a file with a clock that the tests can ignore."""
    return open_source(
        SourceSpec(url=str(path), kind="file", **spec),
        source="lab/cam",
        run_id="test",
        clock_ns=time.time_ns,
    )


def frames_of(path: Path, **spec: Any) -> list[Frame]:
    """All frames of a file."""
    with source_of(path, **spec) as source:
        return only_frames(source)


def only_frames(items: Any) -> list[Frame]:
    """Leave the packets out."""
    return [item for item in items if isinstance(item, Frame)]


def only_packets(items: Sequence[Item]) -> list[VideoPacket]:
    """Leave the frames out."""
    return [item for item in items if isinstance(item, VideoPacket)]


def lumas_of(path: Path) -> list[NDArray[np.uint8]]:
    """Luma of an 8-bit file, line by line out of the planes: slow and obvious."""
    lumas = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            plane = frame.planes[0]
            data, line = bytes(plane), plane.line_size
            rows = [data[line * row : line * row + frame.width] for row in range(frame.height)]
            lumas.append(np.frombuffer(b"".join(rows), np.uint8).reshape(frame.height, -1))
    return lumas


def packet_times_ns(path: Path) -> list[int]:
    """Presentation times as the container has them, in order, in exact arithmetic."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        times = sorted(p.pts * stream.time_base for p in container.demux(stream) if p.size)
    return [round(t * 1_000_000_000) for t in times]
