"""Throughput of the pipeline beside a bare decoder, and how many feeds a machine carries.

Here: the videos that are decoded, some seconds rendered by the capture model, and repeated without
re-encoding.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from rsenf import __version__
from rsenf.bench.harness import Run, known_names
from rsenf.bench.statistics import Row
from rsenf.bench.tables import Column
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
# Usual of network cameras at 30 frames/s; half of it for H.265.
BITRATES_BPS = {"480p": 1_000_000, "720p": 2_000_000, "1080p": 4_000_000, "2160p": 12_000_000}
GOP_FRAMES, FILMED = 60, 300
START = datetime(2026, 1, 1)  # of the first frame, UTC
VERSION, FILMS = 2, "films"  # of records; folder


@dataclass(frozen=True)
class Film:
    """A video of some number of frames."""

    size: str  # of SIZES
    codec: str  # of CODECS
    frames: int  # a multiple of those filmed
    filmed: int = FILMED  # whole seconds, so that the flicker continues at a repetition
    seed: int = 0  # of the scene and the noise

    @property
    def name(self) -> str:
        """Unique file name."""
        return f"{self.size}-{self.codec}-{self.frames}-{self.filmed}-{self.seed}.mp4"

    @property
    def once(self) -> str:
        """File name of the rendered part."""
        return f"once-{self.size}-{self.codec}-{self.filmed}-{self.seed}.mp4"

    @property
    def bitrate_bps(self) -> int:
        """Mean bit rate."""
        return BITRATES_BPS[self.size] // (2 if self.codec == "h265" else 1)

    @property
    def times(self) -> int:
        """Number of repetitions."""
        return self.frames // self.filmed

    @property
    def freq_hz(self) -> FloatArray:
        """Grid's frequency in each rendered second, Hz; its sum is a whole number of cycles."""
        seconds = round(self.filmed / FRAME_RATE)
        freq_hz = synthetic_grid(self.seed, seconds).freq_hz[:seconds]
        total = float(freq_hz.sum())
        return np.asarray(freq_hz + (round(total) - total) / seconds)


def made(film: Film, folder: Path) -> Path:
    """Return a film's file, created if necessary, with a table of the grid beside it."""
    path, once = folder / film.name, folder / film.once
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        lines = (
            f"{START + timedelta(seconds=k):%Y-%m-%d %H:%M:%S},{freq_hz:.6f}"
            for k, freq_hz in enumerate(np.tile(film.freq_hz, film.times))
        )
        table = "\n".join(["time,frequency", *lines, ""])
        reference_of(path).write_text(table, encoding="utf-8")
        if not once.exists():
            _shoot(film, once)
        _repeat(once, path, film.times)
    return path


def reference_of(path: Path) -> Path:
    """Return the table of the grid's frequency of a film."""
    return path.with_suffix(".csv")


def _shoot(film: Film, path: Path) -> None:
    width, height = SIZES[film.size]
    model = CaptureModel(
        light=Light(lamp="led"),
        shutter=Shutter(frame_rate=FRAME_RATE, rows=height, columns=width),
        codec=Codec(name=film.codec, bitrate_bps=film.bitrate_bps, gop_frames=GOP_FRAMES),
    )
    freq_hz = film.freq_hz
    grid = GridPath(np.append(freq_hz, freq_hz[:1]))  # the last row is read after the last second
    frames = render_frames(model, grid, float(film.filmed / FRAME_RATE), film.seed)
    write_video(path, frames, model.codec)


def _repeat(once: Path, path: Path, times: int) -> None:
    """Write a video that repeats another one, by copying its packets."""
    import av

    with whole_file(path) as part, av.open(str(once)) as source, av.open(str(part), "w") as out:
        stream = source.streams.video[0]
        copy = out.add_stream_from_template(stream)
        packets = [packet for packet in source.demux(stream) if packet.size]
        length = sum(packet.duration or 0 for packet in packets)
        for offset in range(0, length * times, length):
            for packet in packets:
                again = av.Packet(bytes(packet))
                again.time_base, again.is_keyframe = packet.time_base, packet.is_keyframe
                assert packet.pts is not None
                assert packet.dts is not None
                again.pts, again.dts = packet.pts + offset, packet.dts + offset
                again.duration, again.stream = packet.duration, copy
                out.mux(again)


def film_facts(film: Film, others: Callable[[], float | None]) -> dict[str, Any]:
    """Return what the records of all turns on a film have, and how busy others were meanwhile."""
    return {
        "version": VERSION,
        "size": film.size,
        "codec": film.codec,
        "bitrate_bps": film.bitrate_bps,
        "others_ratio": others(),
        "cores": os.cpu_count(),
        "rsenf": __version__,
    }


FILM: Column = (
    "film", lambda r: f"{r['size']} {r['codec'].upper().replace('H', 'H.')}",
)  # fmt: skip
BITRATE: Column = ("Mb/s", lambda r: f"{r['bitrate_bps'] / 1e6:g}")


def ms(field: str) -> Callable[[Row], str]:
    """Return what shows a time in milliseconds in a cell."""
    return lambda row: f"{1e3 * row[field]:.0f} ms"


def films_of(
    run: Run, sizes: Sequence[str], codecs: Sequence[str], frames: dict[str, int]
) -> list[Film]:
    """Return the films of the options.

    Parameters
    ----------
    sizes, codecs
        Where no option names others.
    frames : dict
        Number of frames by size, rounded down to whole repetitions.
    """
    sizes, codecs = run.options.sizes or sizes, run.options.codings or codecs
    known_names(sizes, SIZES, "size")
    known_names(codecs, CODECS, "codec")
    return [
        Film(size, codec, max(frames[size] // FILMED, 1) * FILMED, seed=run.options.seed)
        for size in sizes
        for codec in codecs
    ]
