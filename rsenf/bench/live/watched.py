"""Footage of a camera, the feed made of it, and all messages that a monitor receives, in order.

A feed has a slot for each frame period. In an honest feed it has the current frame of the camera;
an attack fills the slots from its start on with other frames, with time stamps and numbers as
expected.
"""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.bench.live import FROZEN, LOOP, OTHER, REPLAY, SPLICE, Feed
from rsenf.bench.live.scene import (
    T0_NS,
    Watched,
    camera_of,
    frame_rate_of,
    reference_blocks,
    watched_grid,
)
from rsenf.bench.scenes import spread
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import Header, RowBlock
from rsenf.messages.schema import Float32Array, FloatArray
from rsenf.model import simulate_rows
from rsenf.model.noise import generator
from rsenf.model.row_level import RowData
from rsenf.rows.stage import blocks_from_luminance
from rsenf.stage import Stage
from rsenf.timebase import nanoseconds, seconds
from rsenf.track import TrackSettings, make_tracker

LEAD_S = 620.0  # footage before the feed, for replay
LOOP_S, SPLICE_S, REPLAY_S, BACK_S = (5.0, 90.0), (20.0, 120.0), (5.0, 600.0), (5.0, 150.0)
OTHER_TIME = 0.5  # share of other cameras that show another time; the rest are live
# Half of the attacks are re-encoded; the others repeat frames bit by bit.
RECODED, RECODED_LEVEL = 0.5, 0.05  # share, and noise of a row mean
LATENCY_S, JITTER_S = 0.2, 0.02  # between the last frame of a block and its arrival


@dataclass(frozen=True, eq=False)
class Shown:
    """A feed as a monitor receives it, and the truth."""

    blocks: list[RowBlock]  # with the host's time of their arrival
    attack_ns: int | None  # host's time of the first false frame
    watched: Watched
    truth: dict[str, float | str | bool]


def show(feed: Feed, grids: Path | None) -> Shown:
    """Simulate the footage, and fill the feed's slots; ``grids``: folder of measured grids."""
    watched = watched_grid(grids, feed.part, feed.seed, LEAD_S, feed.length_s)
    rate_hz = float(frame_rate_of(feed.seed))
    footage = _take(feed, watched, "camera", watched.footage_s)
    lead, slots = round(LEAD_S * rate_hz), round(feed.length_s * rate_hz)
    level = footage.level[lead : lead + slots].copy()
    time_s = footage.frame_time_s[lead : lead + slots]
    model = footage.capture.model
    factor = 1 + footage.truth["clock_ppm"] * 1e-6
    true_s = watched.footage_s + time_s / factor
    truth: dict[str, float | str | bool] = {
        "clock_ppm": footage.truth["clock_ppm"],
        "frame_rate": str(model.shutter.frame_rate),
        "idle_ratio": model.shutter.idle_ratio,
        "lamp": model.light.lamp,
        "coded": any(effect.name == "codec_lowpass" for effect in model.effects),
        "grid": watched.stretch.name,
    }
    attack_ns = None
    if feed.attack_s is not None:
        first = round(feed.attack_s * rate_hz)
        attack_ns = T0_NS + nanoseconds(float(true_s[first]))
        rng = generator(feed.seed, "live attack")
        if feed.kind == OTHER:
            false, truth["away_s"] = _other_camera(feed, watched, slots - first, rng)
        else:
            index, truth["away_s"] = _again(feed.kind, lead + first, slots - first, rate_hz, rng)
            false = footage.level[index]
        recoded = feed.kind != FROZEN and bool(rng.random() < RECODED)
        truth["recoded"] = recoded
        if recoded:
            noise = rng.standard_normal(false.shape, dtype=np.float32)
            false = false + np.float32(RECODED_LEVEL) * noise
        level[first:] = false
    return Shown(_blocks(feed, level, time_s - time_s[0], true_s), attack_ns, watched, truth)


def _take(feed: Feed, watched: Watched, which: str, start_s: float) -> RowData:
    length_s = LEAD_S + feed.length_s + 1.0
    model = camera_of(feed.seed, length_s, which)
    # Seeded by the camera's name, as in `camera_of`.
    seed = int(generator(feed.seed, f"live footage of {which}").integers(2**31))
    return simulate_rows(model, watched.path(start_s), length_s, seed)


def _again(
    kind: str, now: int, count: int, rate_hz: float, rng: np.random.Generator
) -> tuple[NDArray[np.intp], float]:
    """Return the indices of the frames of an attack, and how far back they are, s."""
    ahead = np.arange(count)
    if kind == FROZEN:
        return np.full(count, now - 1), 0.0
    if kind == LOOP:
        length = round(spread(rng, LOOP_S) * rate_hz)
        return now - length + ahead % length, length / rate_hz
    back = round(spread(rng, REPLAY_S if kind == REPLAY else BACK_S) * rate_hz)
    if kind == REPLAY:
        return now - back + ahead, back / rate_hz
    assert kind == SPLICE
    length = round(spread(rng, SPLICE_S) * rate_hz)
    return np.where(ahead < length, now - back + ahead, now + ahead), back / rate_hz


def _other_camera(
    feed: Feed, watched: Watched, count: int, rng: np.random.Generator
) -> tuple[Float32Array, float]:
    """Return frames of another camera, and their age, s."""
    old_s = spread(rng, REPLAY_S) if rng.random() < OTHER_TIME else 0.0
    footage = _take(feed, watched, "other camera", watched.footage_s - old_s)
    return footage.level[-count:], old_s


def _blocks(
    feed: Feed, level: Float32Array, time_s: FloatArray, true_s: FloatArray
) -> list[RowBlock]:
    """Cut a feed into blocks with the delay and jitter of a network."""
    blocks = list(blocks_from_luminance(level, time_s, Header(source=f"bench/{feed.key}")))
    late_s = LATENCY_S + generator(feed.seed, "live arrival").exponential(JITTER_S, len(blocks))
    last = np.array([block.header.frame_last for block in blocks])
    arrival_s = np.maximum.accumulate(true_s[last] + late_s)
    return [
        dataclasses.replace(
            block,
            header=dataclasses.replace(
                block.header, arrival_time_ns=T0_NS + nanoseconds(float(at_s))
            ),
        )
        for block, at_s in zip(blocks, arrival_s, strict=True)
    ]


IDLE_EVERY_S = 30.0  # the default interval would double the time of a trial


def _tracked(blocks: Sequence[RowBlock], nominal_hz: float) -> Iterator[Any]:
    """Yield the estimates, with the arrival time of the rows that complete them.

    Estimates at the end of the stream are left out: a live monitor doesn't get them.
    """
    stages: tuple[Stage, ...] = (
        make_tracker(TrackSettings(nominal_hz=nominal_hz)),
        make_idle(IdleSettings(nominal_hz=nominal_hz, every_s=IDLE_EVERY_S)),
    )
    for block in blocks:
        for stage in stages:
            for estimate in stage.update(block):
                arrived_ns = block.header.arrival_time_ns
                header = dataclasses.replace(estimate.header, arrival_time_ns=arrived_ns)
                yield dataclasses.replace(estimate, header=header)


@dataclass(frozen=True, eq=False)
class Watch:
    """A feed, and all messages of a monitor in the order of their arrival."""

    shown: Shown
    messages: list[Any]

    def since_begin_s(self, host_ns: int) -> float:
        """Return a host's time relative to the arrival of the first rows, s."""
        return seconds(host_ns - self.shown.blocks[0].header.arrival_time_ns)


def watch(feed: Feed, grids: Path | None) -> Watch:
    """Return a feed with all messages of a monitor; ``grids``: folder of measured grids."""
    shown = show(feed, grids)
    # At equal times in the order of the streams.
    streams = (
        reference_blocks(shown.watched, feed.length_s, feed.seed),
        shown.blocks,
        _tracked(shown.blocks, shown.watched.stretch.nominal_hz),
    )
    return Watch(shown, list(heapq.merge(*streams, key=lambda m: m.header.arrival_time_ns)))
