"""Feeds of simulated cameras, honest and not, with the reference of the grid they are on."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.idle import IdleSettings, make_idle
from rsenf.live import Live, LiveSettings
from rsenf.messages import Alarm, Header, Liveness, ReferenceBlock, RowBlock
from rsenf.model import CaptureModel, GridPath, Light, Shutter, simulate_rows, synthetic_grid
from rsenf.rows.luminance import blocks_from_luminance
from rsenf.run.runner import Runner
from rsenf.track import TrackSettings, make_tracker

T0_NS = 1_700_000_000_000_000_000
GRID_S = 2400
START_S = 900.0  # of the feeds, on the grid
NS = 1_000_000_000
Float = NDArray[np.float64]


@lru_cache(maxsize=4)
def grid_hz(seed: int = 3) -> Float:
    path = synthetic_grid(seed, GRID_S + 2.0)
    return np.diff(path.cycles(np.arange(GRID_S + 1.0)))


def reference(seed: int = 3, *, first: int = 0, until: int = GRID_S, total: int = GRID_S) -> Any:
    freq = grid_hz(seed)[first:until]
    return ReferenceBlock(
        header=Header(source="reference/ce"), grid="ce", nominal_hz=50.0, t0_ns=T0_NS,
        step_ns=NS, first=first, samples=freq.size, total=total, freq_hz=freq,
        readings=np.ones(freq.size, np.uint32),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class Feed:
    """Rows (frames, rows, strips) and their times; ``start_s`` on the grid."""

    level: NDArray[np.float32]
    t_s: Float
    start_s: float = START_S

    def from_second(self, begin_s: float, end_s: float) -> slice:
        return slice(*np.searchsorted(self.t_s, [begin_s, end_s]).tolist())


@lru_cache(maxsize=16)
def film(
    seconds: float, *, start_s: float = START_S, seed: int = 1, idle: float = 0.3,
    swing: float = 0.1, rate: str = "30", grid_seed: int = 3,
) -> Feed:  # fmt: skip
    """What a camera films of the grid from a time on."""
    shutter = Shutter(frame_rate=Fraction(rate), rows=48, columns=96, idle_ratio=idle)
    path = GridPath(grid_hz(grid_seed), 1.0, start_s)
    model = CaptureModel(shutter=shutter, light=Light(lamp="led", flicker_ratio=swing))
    made = simulate_rows(model, path, seconds, seed)
    return Feed(made.level, np.asarray(made.frame_time_s, np.float64), start_s)


def blocks(feed: Feed, *, epoch: int = 0, delay_s: float = 0.2) -> Iterator[RowBlock]:
    """Row blocks as they arrive."""
    arrive_ns = T0_NS + round((feed.start_s + delay_s) * NS)
    for block in blocks_from_luminance(feed.level, feed.t_s, Header(run_id="r", source="lab/cam")):
        header = dataclasses.replace(
            block.header, epoch=epoch, arrival_time_ns=arrive_ns + block.header.pts_ns
        )
        yield dataclasses.replace(block, header=header)


def tracked(rows: Iterable[RowBlock], *, idle: bool = False) -> list[Any]:
    """Rows with the estimates that the stages make of them, in the order they come."""
    out: list[Any] = []
    stages = [Runner("track", lambda: make_tracker(TrackSettings()))]
    if idle:
        stages.append(Runner("idle", lambda: make_idle(IdleSettings())))
    for block in rows:
        out.append(block)
        for stage in stages:
            out += stage.feed(block)
    return out


def judged(
    messages: Iterable[Any], *, stage: Live | None = None, settings: LiveSettings | None = None
) -> tuple[list[Liveness], list[Alarm]]:
    """What the stage says of messages."""
    live = stage or Live(settings)
    out = [said for message in messages for said in live.update(message)] + live.flush()
    return [m for m in out if isinstance(m, Liveness)], [m for m in out if isinstance(m, Alarm)]
