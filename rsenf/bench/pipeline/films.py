"""Videos to be decoded: filmed by the capture model for a few seconds, and played over and over."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.messages.schema import FloatArray
from rsenf.model import (
    CaptureModel,
    Codec,
    GridPath,
    Light,
    Shutter,
    render_frames,
    synthetic_grid,
    write_video,
)
from rsenf.whole_file import whole_file

SIZES = {"480p": (854, 480), "720p": (1280, 720), "1080p": (1920, 1080), "2160p": (3840, 2160)}
CODECS = ("h264", "h265")
FRAME_RATE = Fraction(30)
# A network camera's usual setting at 30 fps; H.265 does with half of it.
BITRATES_BPS = {"480p": 1_000_000, "720p": 2_000_000, "1080p": 4_000_000, "2160p": 12_000_000}
GOP_FRAMES, FILMED = 60, 300
START = datetime(2026, 1, 1)  # of the first frame, UTC


@dataclass(frozen=True)
class Film:
    """A video of so many frames.

    Parameters
    ----------
    size : str
        Of :data:`SIZES`.
    codec : str
        Of :data:`CODECS`.
    frames : int
        How many are played; a whole number of times those that are filmed.
    filmed : int
        How many are filmed, whole seconds: the lamp's flicker goes on when they are played again.
    seed : int
        Of the scene and the noise.
    """

    size: str
    codec: str
    frames: int
    filmed: int = FILMED
    seed: int = 0

    @property
    def name(self) -> str:
        """File name that tells it from any other."""
        return f"{self.size}-{self.codec}-{self.frames}-{self.filmed}-{self.seed}.mp4"

    @property
    def once(self) -> str:
        """File name of what is filmed."""
        return f"once-{self.size}-{self.codec}-{self.filmed}-{self.seed}.mp4"

    @property
    def bitrate_bps(self) -> int:
        """Mean bit rate."""
        return BITRATES_BPS[self.size] // (2 if self.codec == "h265" else 1)

    @property
    def times(self) -> int:
        """How often what is filmed is played."""
        return self.frames // self.filmed

    @property
    def freq_hz(self) -> FloatArray:
        """Grid's frequency in each second that is filmed: of a whole number of cycles in all."""
        seconds = round(self.filmed / FRAME_RATE)
        freq_hz = synthetic_grid(self.seed, seconds).freq_hz[:seconds]
        total = float(freq_hz.sum())
        return np.asarray(freq_hz + (round(total) - total) / seconds)


def made(film: Film, folder: Path) -> Path:
    """Return a film's file, which is made where there is none, with the grid's table beside it."""
    path, once = folder / film.name, folder / film.once
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_grid(film, reference_of(path))
        if not once.exists():
            shoot(film, once)
        repeat(once, path, film.times)
    return path


def reference_of(path: Path) -> Path:
    """Table of the grid's frequency that a film was taken under."""
    return path.with_suffix(".csv")


def write_grid(film: Film, path: Path) -> None:
    """Write the frequency in each second of a film, as it is played."""
    lines = (
        f"{START + timedelta(seconds=k):%Y-%m-%d %H:%M:%S},{freq_hz:.6f}"
        for k, freq_hz in enumerate(np.tile(film.freq_hz, film.times))
    )
    path.write_text("\n".join(["time,frequency", *lines, ""]), encoding="utf-8")


def shoot(film: Film, path: Path) -> None:
    """Film what is filmed of it."""
    width, height = SIZES[film.size]
    model = CaptureModel(
        light=Light(lamp="led"),
        shutter=Shutter(frame_rate=FRAME_RATE, rows=height, columns=width),
        codec=Codec(name=film.codec, bitrate_bps=film.bitrate_bps, gop_frames=GOP_FRAMES),
    )
    freq_hz = film.freq_hz
    grid = GridPath(np.append(freq_hz, freq_hz[:1]))  # the last line is read after the last frame
    frames = render_frames(model, grid, float(film.filmed / FRAME_RATE), film.seed)
    write_video(path, frames, model.codec)


def repeat(once: Path, path: Path, times: int) -> None:
    """Write a video that plays another so many times, without decoding it."""
    import av

    with whole_file(path) as part, av.open(str(once)) as source, av.open(str(part), "w") as out:
        stream = source.streams.video[0]
        copy = out.add_stream_from_template(stream)
        packets = [packet for packet in source.demux(stream) if packet.size]
        length = sum(packet.duration or 0 for packet in packets)
        for offset in _offsets(length, times):
            for packet in packets:
                again = av.Packet(bytes(packet))
                again.time_base, again.is_keyframe = packet.time_base, packet.is_keyframe
                assert packet.pts is not None
                assert packet.dts is not None
                again.pts, again.dts = packet.pts + offset, packet.dts + offset
                again.duration, again.stream = packet.duration, copy
                out.mux(again)


def _offsets(length: int, times: int) -> Iterator[int]:
    return (length * n for n in range(times))


def shown_film(row: dict[str, Any]) -> str:
    """Return size and codec of a film for a cell, such as ``720p H.264``."""
    return f"{row['size']} {row['codec'].upper().replace('H', 'H.')}"
