"""Files that are not what a person took them for, each with what is wrong in its name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np


def grey_video(path: Path, frames: int, level: int) -> Path:
    """A video of one grey, 64 × 48 at 30 frames/s."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        picture = np.full((72, 64), level, np.uint8)
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(picture, "yuv420p")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def only_sound(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=8000)
        silence = av.AudioFrame.from_ndarray(np.zeros((1, 8000), np.float32), "fltp", "mono")
        silence.rate = 8000
        container.mux(stream.encode(silence))
        container.mux(stream.encode(None))
    return path


def repacked(clip: Path, path: Path, options: dict[str, str]) -> Path:
    """The same packets in another container."""
    with av.open(str(clip)) as source, av.open(str(path), "w", options=options) as target:
        inside = source.streams.video[0]
        outside = target.add_stream_from_template(inside)
        for packet in source.demux(inside):
            if packet.dts is not None:
                packet.stream = outside
                target.mux(packet)
    return path


def cut(whole: Path, path: Path, share: float) -> Path:
    """The first part of a file."""
    content = whole.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    return path


def _npz(**arrays: object) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        np.savez(path, **arrays)  # type: ignore[arg-type]  # whatever it is that we want there

    return write


def _bytes(content: bytes) -> Callable[[Path], None]:
    return lambda path: _discard(path.write_bytes(content))


def _discard(_: object) -> None:
    return None


def _cut_npz(path: Path) -> None:
    np.savez(path, luminance=np.zeros(900), frame_rate_hz=30.0)
    path.write_bytes(path.read_bytes()[:3000])


def _flipped_npz(path: Path) -> None:
    """A compressed file with a wrong bit in the middle of its data."""
    noise = np.random.default_rng(1).normal(100.0, 1.0, 900)
    np.savez_compressed(path, luminance=noise, frame_rate_hz=30.0)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


_TIMES = np.arange(900) / 30
# File name → how to make it. All of these end with exit code 1.
USELESS: dict[str, Callable[[Path], object]] = {
    "text.mp4": _bytes(b"This is no video.\n"),
    "empty.mp4": _bytes(b""),
    "zeros.mp4": _bytes(bytes(4096)),
    "text.mcap": _bytes(b"This is no recording.\n"),
    "empty.mcap": _bytes(b""),
    "only_magic.mcap": _bytes(b"\x89MCAP0\r\n"),
    "sound.mp4": only_sound,
    "text.npz": _bytes(b"These are no arrays.\n"),
    "cut.npz": _cut_npz,
    "flipped.npz": _flipped_npz,
    "nan.npz": _npz(rows=np.full((900, 4), np.nan), frame_time_s=_TIMES),
    "times.npz": _npz(rows=np.ones((900, 4)), frame_time_s=_TIMES[:-1]),
    "backward.npz": _npz(rows=np.ones((900, 4)), frame_time_s=_TIMES[::-1]),
    "shape.npz": _npz(luminance=np.ones((900, 4)), frame_rate_hz=30.0),
    "keys.npz": _npz(rows=np.ones((900, 4)), times=_TIMES),
    "nothing.npz": _npz(luminance=np.ones(0), frame_rate_hz=30.0),
    "rate.npz": _npz(luminance=np.ones(900), frame_rate_hz=0.0),
    "words.npz": _npz(luminance=np.array(["bright", "dark"]), frame_rate_hz=30.0),
    "objects.npz": _npz(luminance=np.array([None, 1], dtype=object), frame_rate_hz=30.0),
}
