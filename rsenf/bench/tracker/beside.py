"""Processor time and memory of an ENF method by itself, and of all stages beside decoding 1080p.

They run on rows of a wall in a lamp's light, generated block by block in constant memory.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rsenf.bench.harness import timed, watch_memory
from rsenf.bench.measure import arrived, frame_of
from rsenf.bench.pipeline import FRAME_RATE, SIZES, Film, made
from rsenf.decode.stream import luma_plane
from rsenf.idle import IdleSettings
from rsenf.live import Live
from rsenf.live.settings import LiveSettings
from rsenf.match.stage import Match
from rsenf.messages import Header, ReferenceBlock, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.model.noise import generator
from rsenf.rows.stage import Rows, blocks_from_luminance
from rsenf.run.stages import flicker_stages
from rsenf.stage import Stage
from rsenf.timebase import nanoseconds
from rsenf.track import TrackSettings, make_tracker

NOMINAL_HZ, AWAY_HZ, PERIOD_S = 50.0, 0.02, 300.0
LEVEL, TEXTURE, FLICKER, NOISE = 110.0, 0.08, 0.08, 0.05
SECOND, THIRD = 0.2, 0.05  # harmonics, relative to the first
READ_OUT_RATIO, STRIPS, BLOCK_FRAMES = 0.75, 2, 8
T0_NS = 1_767_225_600 * 10**9
LATE_S = 0.2  # of a block, after its last frame
WARM_UP_S = 45.0  # until the flicker is detected and windows are full
INTERIM_S = 60.0  # between interim results of the match
AFTER = ("track", "idle", "match", "live")


class LampRows:
    """Row blocks of a lamp on a grid whose frequency varies sinusoidally.

    ``seed`` is that of texture and noise.
    """

    def __init__(self, rows: int, frame_rate_hz: float, seed: int) -> None:
        self._rows, self._rate_hz = rows, frame_rate_hz
        self._rng = generator(seed, "tracker bench")
        self._wall = LEVEL * (1 + TEXTURE * self._rng.standard_normal((rows, STRIPS)))
        self._line_s = READ_OUT_RATIO / frame_rate_hz * np.arange(rows) / rows

    def blocks(self, start_s: float, length_s: float) -> Iterator[RowBlock]:
        """Return the row blocks of an interval; the next call may continue at its end."""
        per_s = self._rate_hz / BLOCK_FRAMES
        first, end = (round(t_s * per_s) for t_s in (start_s, start_s + length_s))
        return map(self._block, range(first, end))

    def _block(self, seq: int) -> RowBlock:
        number = seq * BLOCK_FRAMES + np.arange(BLOCK_FRAMES, dtype=np.int64)
        t_s = number / self._rate_hz
        angle = 4 * np.pi * _cycles(t_s[:, None] + self._line_s)
        flicker = np.cos(angle) + SECOND * np.cos(2 * angle) + THIRD * np.cos(3 * angle)
        level = self._wall * (1 + FLICKER * flicker[:, :, None])
        level += NOISE * self._rng.standard_normal(level.shape)
        (block,) = blocks_from_luminance(level, t_s, Header(source="bench/tracker"))
        header = dataclasses.replace(
            block.header, seq=seq, frame_first=int(number[0]), frame_last=int(number[-1]),
            arrival_time_ns=T0_NS + nanoseconds(float(t_s[-1]) + LATE_S),
        )  # fmt: skip
        return dataclasses.replace(block, header=header, frame_number=number)


def _cycles(t_s: FloatArray) -> FloatArray:
    """Return the mains cycles since the beginning, in the shape of the times."""
    turn = 2 * np.pi / PERIOD_S
    return np.asarray(NOMINAL_HZ * t_s + AWAY_HZ / turn * (1 - np.cos(turn * t_s)))


def _reference(seconds: int) -> ReferenceBlock:
    """Return the grid's mean frequency in each second since the beginning."""
    freq_hz = np.diff(_cycles(np.arange(seconds + 1.0)))
    return ReferenceBlock(
        header=Header(source="reference/bench", arrival_time_ns=T0_NS), grid="bench",
        nominal_hz=NOMINAL_HZ, t0_ns=T0_NS, step_ns=nanoseconds(1.0), samples=seconds,
        total=seconds, freq_hz=freq_hz, readings=np.ones(seconds, np.uint32),
    )  # fmt: skip


@dataclass(frozen=True)
class Hour:
    """An ENF method on rows of one number and frame rate."""

    method: str
    rows: int
    frame_rate_hz: float
    parts: int  # repeats
    part_s: float  # of video in each
    settings: dict[str, Any] = field(default_factory=dict)  # of the tracker, beside its method

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        given = "".join(f" {name}={value}" for name, value in self.settings.items())
        size = f"{self.rows} rows {self.frame_rate_hz:g} fps"
        return f"{self.method}{given} {size} {self.parts} x {self.part_s:g} s"

    def measure(self, seed: int) -> dict[str, Any]:
        """Measure it after the warm-up; return processor time of an hour, and memory."""
        light = LampRows(self.rows, self.frame_rate_hz, seed)
        most_mb = watch_memory()
        stage = make_tracker(TrackSettings(method=self.method, **self.settings))
        _spent(stage, light.blocks(0.0, WARM_UP_S))
        cpu_s = [
            _spent(stage, light.blocks(WARM_UP_S + k * self.part_s, self.part_s))[0]
            for k in range(self.parts)
        ]
        peak_mb = most_mb()
        return {
            **{n: getattr(self, n) for n in ("method", "settings", "rows", "frame_rate_hz")},
            "hours": self.parts * self.part_s / 3600.0,
            "cpu_s_per_hour": [one * 3600.0 / self.part_s for one in cpu_s],
            "peak_mb": peak_mb,
        }


def _spent(stage: Stage, messages: Iterable[Any]) -> tuple[float, list[Any]]:
    """Run a stage on messages; return its own processor time, s, and what it makes of them."""
    total_s, out = 0.0, list[Any]()
    for message in messages:
        made, spent_s = timed(stage.update, message)
        total_s += spent_s
        out += made
    return total_s, out


@dataclass(frozen=True)
class Beside:
    """All stages with default settings, in turn with a decoder."""

    frames: int  # of the film, whole seconds
    parts: int  # repeats
    part_s: float  # of video in each

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"beside 1080p {self.frames} frames {self.parts} x {self.part_s:g} s"

    def measure(self, seed: int, films: Path) -> dict[str, Any]:
        """Decode and sample the film, and run the stages on rows, in each repeat."""
        film = Film("1080p", "h264", self.frames, self.frames, seed)
        path = made(film, films)
        light = LampRows(SIZES["1080p"][1], float(FRAME_RATE), seed)
        after = _stages(int(WARM_UP_S + self.parts * self.part_s) + 1)
        _spent_by(after, light.blocks(0.0, WARM_UP_S))
        _decoded(path)
        parts, seconds = [], self.frames / float(FRAME_RATE)
        for k in range(self.parts):
            frames = {"decode": _decoded(path), "rows": _sampled(path)}
            blocks = light.blocks(WARM_UP_S + k * self.part_s, self.part_s)
            ms = {name: 1e3 * s / seconds for name, s in frames.items()}
            spent_s = _spent_by(after, blocks)
            parts.append(ms | {name: 1e3 * s / self.part_s for name, s in spent_s.items()})
        return {"bitrate_bps": film.bitrate_bps, "ms_per_s": parts}


def _stages(seconds: int) -> dict[str, Stage]:
    """Return all stages after the row means, by name, with a reference of so many seconds."""
    track, idle = flicker_stages(TrackSettings(), IdleSettings())
    match, live = Match(interim_every_s=INTERIM_S), Live(LiveSettings(), start_utc_ns=T0_NS)
    known = _reference(max(seconds, 3600))
    match.update(known)
    live.update(known)
    return dict(zip(AFTER, (track.make(), idle.make(), match, live), strict=True))


def _spent_by(stages: dict[str, Stage], blocks: Iterable[RowBlock]) -> dict[str, float]:
    """Run the stages on rows, connected as in one process; return the processor time of each, s."""
    total = dict.fromkeys(stages, 0.0)

    def run(name: str, messages: list[Any]) -> list[Any]:
        spent_s, out = _spent(stages[name], messages)
        total[name] += spent_s
        return out

    for block in blocks:
        at_ns = block.header.arrival_time_ns
        tracked, idle = ([arrived(e, at_ns) for e in run(n, [block])] for n in ("track", "idle"))
        run("match", tracked)
        run("live", [block, *tracked, *idle])
    return total


def _sampled(path: Path) -> float:
    """Return the processor time of the row means of a film, s, with the steady-pixel mask."""
    rows, spent_s = Rows(), []
    _decoded(path, lambda n, luma: spent_s.append(_spent(rows, [frame_of(n, luma)])[0]))
    return sum(spent_s)


def _decoded(path: Path, show: Callable[[int, Any], None] = lambda number, luma: None) -> float:
    """Decode a film on one thread, call ``show`` on every plane; return the processor time, s."""
    import av

    begun_s = time.process_time()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type, stream.thread_count = "NONE", 1
        for number, frame in enumerate(container.decode(stream)):
            show(number, luma_plane(frame))
    return time.process_time() - begun_s
