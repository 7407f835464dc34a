"""A feed from its seed to all messages that a monitor receives, in order.

Here are its grid, camera, lamp and clock, footage of the camera, and the feed made of it. A feed
has a slot for each frame period. In an honest feed it has the current frame of the camera; an
attack fills the slots from its start on with other frames, with time stamps and numbers as
expected.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.bench import scenes
from rsenf.bench.live import FROZEN, LOOP, OTHER, REPLAY, SPLICE, DrawnFeed
from rsenf.bench.measure import arrived
from rsenf.idle import IdleSettings, make_idle
from rsenf.match.series import Grid
from rsenf.messages import Header, ReferenceBlock, RowBlock
from rsenf.messages.schema import Float32Array, FloatArray
from rsenf.model import CaptureModel, GridPath, Light, Shutter, simulate_rows, synthetic_grid
from rsenf.model.noise import Sensor, generator, wander
from rsenf.model.row_level import RowData
from rsenf.rows.stage import blocks_from_luminance
from rsenf.stage import Stage
from rsenf.timebase import nanoseconds, seconds
from rsenf.track import TrackSettings, make_tracker

PAST_S = 3600.0  # of reference before the feed
MARGIN_S = 30.0
LATE_S = 0.5  # delay of a reference sample after its end
_SYNTHETIC_S = 3 * 3600.0
T0_NS = 1_767_225_600 * 10**9  # host's clock at the first sample of the grid
FRAME_RATES = (Fraction(24), Fraction(25), Fraction(30000, 1001), Fraction(30))
LAMPS = ("led", "halogen", "incandescent", "cfl")
DAYLIGHT_RATIO = (0.0, 0.8)
# Few rows and columns save time; full-well capacities are of dim to bright scenes.
LINES, COLUMNS, WHITE_E = 48, (32.0, 512.0), (500.0, 12000.0)
# Share of encoded feeds, attenuation of flicker, and wander of its phase: an error of the ENF of
# 0.1 to 3 mHz over a second, as in videos at 150k to 50k.
CODED, GAIN, WANDER_RAD, WANDER_S = 0.5, (0.1, 1.0), (0.005, 0.06), (3.0, 15.0)
IDLE_RATIO = (0.02, 0.6)
RAD_PER_S = 2 * math.pi * 100.0  # of the flicker, approximately
JITTER_S, GAIN_RATIO, GAIN_S = (1e-6, 3e-5), (5e-4, 5e-3), (1.0, 30.0)
LEAD_S = 620.0  # footage before the feed, for replay
LOOP_S, SPLICE_S, REPLAY_S, BACK_S = (5.0, 90.0), (20.0, 120.0), (5.0, 600.0), (5.0, 150.0)
OTHER_TIME = 0.5  # share of other cameras that show another time; the rest are live
# Half of the attacks are re-encoded; the others repeat frames bit by bit.
RECODED, RECODED_LEVEL = 0.5, 0.05  # share, and noise of a row mean
LATENCY_S, ARRIVAL_S = 0.2, 0.02  # between the last frame of a block and its arrival, and jitter
IDLE_EVERY_S = 30.0  # the default interval would double the time of a trial


def _watched_grid(folder: Path | None, feed: DrawnFeed) -> tuple[Grid, float]:
    """Draw the grid, synthetic without a folder of measured data, and the feed's start in it, s."""
    rng = generator(feed.seed, f"live grid {feed.part}")
    before_s, after_s = max(PAST_S, LEAD_S) + MARGIN_S, feed.length_s + MARGIN_S
    if folder is None:
        drawn, nominal_hz = int(rng.integers(2**31)), float(rng.choice([50.0, 60.0]))
        path = synthetic_grid(drawn, _SYNTHETIC_S, nominal_hz=nominal_hz)
        stretch = Grid("synthetic", nominal_hz, 0, path.step_s, path.freq_hz)
    else:
        stretch = scenes.stretch_of(folder, feed.part, rng)
    while True:
        at_s = float(rng.uniform(before_s, stretch.duration_s - after_s))
        first, last = (int((at_s + s) / stretch.step_s) for s in (-LEAD_S - MARGIN_S, after_s))
        if np.isfinite(stretch.freq_hz[first:last]).all():
            return stretch, at_s


def _reference_blocks(of: Grid, feed_s: float, feed: DrawnFeed) -> Iterator[ReferenceBlock]:
    """Yield the reference as it arrives, with noise, rounded: the past, then sample by sample."""
    at_s = feed_s - PAST_S, feed_s, feed_s + feed.length_s
    begin, now, end = (int(t_s / of.step_s) for t_s in at_s)
    end += 1
    noise_hz = scenes.REFERENCE_NOISE_HZ / np.sqrt(of.step_s)
    rng = generator(feed.seed, "live reference")
    freq_hz = scenes.published(of.freq_hz[begin:end], noise_hz, rng)
    step_ns = nanoseconds(of.step_s)
    t0_ns = T0_NS + begin * step_ns
    cuts = [0, *range(now - begin, end - begin + 1)]
    for seq, (first, stop) in enumerate(pairwise(cuts)):
        header = Header(
            source=f"reference/{of.name}", seq=seq, pts_ns=first * step_ns,
            arrival_time_ns=t0_ns + stop * step_ns + nanoseconds(LATE_S),
        )  # fmt: skip
        yield ReferenceBlock(
            header=header, grid=of.name, nominal_hz=of.nominal_hz, t0_ns=t0_ns, step_ns=step_ns,
            first=first, samples=stop - first, total=0, freq_hz=freq_hz[first:stop],
            readings=np.isfinite(freq_hz[first:stop]).astype(np.uint32),
        )  # fmt: skip


def _frame_rate_of(seed: int) -> Fraction:
    """Return the frame rate of a feed, also of another camera that replaces it."""
    return FRAME_RATES[int(generator(seed, "live frame rate").integers(len(FRAME_RATES)))]


def _camera_of(seed: int, length_s: float, which: str) -> CaptureModel:
    """Draw a camera and its scene; each name is a camera of its own."""
    rng = generator(seed, f"live {which}")
    lamp, daylight_ratio = str(rng.choice(LAMPS)), float(rng.uniform(*DAYLIGHT_RATIO))
    rate, columns = _frame_rate_of(seed), round(scenes.spread(rng, COLUMNS))
    idle_ratio = float(rng.uniform(*IDLE_RATIO))
    model = CaptureModel(
        name=f"{which} {seed}",
        light=Light(lamp=lamp, daylight_ratio=daylight_ratio),
        shutter=Shutter(frame_rate=rate, rows=LINES, columns=columns, idle_ratio=idle_ratio),
        sensor=Sensor(white_e=scenes.spread(rng, WHITE_E)),
        scene=scenes.scene_of(rng),
    )
    model = model.with_effect("exposure", exposure_s=scenes.spread(rng, scenes.EXPOSURE_S))
    model = scenes.with_clock_error(model, rng)
    jitter_s, wander_rad = scenes.spread(rng, JITTER_S), 0.0
    if rng.random() < CODED:
        model = model.with_effect("codec_lowpass", gain=scenes.spread(rng, GAIN))
        wander_rad = scenes.spread(rng, WANDER_RAD)
    # The delay of each frame: white jitter, and one that has the codec's phase wander.
    count = math.ceil(length_s * float(rate)) + 1
    wandering = wander(rng, count, 1 / float(rate), scenes.spread(rng, WANDER_S))
    late_s = jitter_s * rng.standard_normal(count) + wander_rad / RAD_PER_S * wandering
    model = model.with_effect("capture_jitter", late_s=tuple(late_s.tolist()))
    gain_ratio, time_s = scenes.spread(rng, GAIN_RATIO), scenes.spread(rng, GAIN_S)
    return model.with_effect("auto_exposure", gain_ratio=gain_ratio, time_constant_s=time_s)


@dataclass(frozen=True, eq=False)
class Shown:
    """A feed as a monitor receives it, and the truth."""

    blocks: list[RowBlock]  # with the host's time of their arrival
    attack_ns: int | None  # host's time of the first false frame
    stretch: Grid  # of the grid
    feed_s: float  # start of the feed in it
    truth: dict[str, float | str | bool]

    def since_begin_s(self, host_ns: int) -> float:
        """Return a host's time relative to the arrival of the first rows, s."""
        return seconds(host_ns - self.blocks[0].header.arrival_time_ns)


def _show(feed: DrawnFeed, grids: Path | None) -> Shown:
    """Simulate the footage, and fill the feed's slots; grids are synthetic without their folder."""
    of, feed_s = _watched_grid(grids, feed)
    footage_s = feed_s - LEAD_S
    rate_hz = float(_frame_rate_of(feed.seed))
    footage = _take(feed, of, "camera", footage_s)
    lead, slots = round(LEAD_S * rate_hz), round(feed.length_s * rate_hz)
    level = footage.level[lead : lead + slots].copy()
    time_s = footage.frame_time_s[lead : lead + slots]
    model = footage.capture.model
    factor = 1 + footage.truth["clock_ppm"] * 1e-6
    true_s = footage_s + time_s / factor
    truth: dict[str, float | str | bool] = {
        "clock_ppm": footage.truth["clock_ppm"],
        "frame_rate": str(model.shutter.frame_rate),
        "idle_ratio": model.shutter.idle_ratio,
        "lamp": model.light.lamp,
        "coded": any(effect.name == "codec_lowpass" for effect in model.effects),
        "grid": of.name,
    }
    attack_ns = None
    if feed.attack_s is not None:
        first = round(feed.attack_s * rate_hz)
        attack_ns = T0_NS + nanoseconds(float(true_s[first]))
        rng = generator(feed.seed, "live attack")
        if feed.kind == OTHER:
            old_s = scenes.spread(rng, REPLAY_S) if rng.random() < OTHER_TIME else 0.0
            footage = _take(feed, of, "other camera", footage_s - old_s)
            false, truth["away_s"] = footage.level[first - slots :], old_s
        else:
            index, truth["away_s"] = _again(feed.kind, lead + first, slots - first, rate_hz, rng)
            false = footage.level[index]
        recoded = feed.kind != FROZEN and bool(rng.random() < RECODED)
        truth["recoded"] = recoded
        if recoded:
            noise = rng.standard_normal(false.shape, dtype=np.float32)
            false = false + np.float32(RECODED_LEVEL) * noise
        level[first:] = false
    blocks = _blocks(feed, level, time_s - time_s[0], true_s)
    return Shown(blocks, attack_ns, of, feed_s, truth)


def _take(feed: DrawnFeed, of: Grid, which: str, start_s: float) -> RowData:
    length_s = LEAD_S + feed.length_s + 1.0
    model = _camera_of(feed.seed, length_s, which)
    # Seeded by the camera's name, as in `_camera_of`.
    seed = int(generator(feed.seed, f"live footage of {which}").integers(2**31))
    path = GridPath(of.freq_hz, of.step_s, start_s, of.nominal_hz)
    return simulate_rows(model, path, length_s, seed)


def _again(
    kind: str, now: int, count: int, rate_hz: float, rng: np.random.Generator
) -> tuple[NDArray[np.intp], float]:
    """Return the indices of the frames of an attack, and how far back they are, s."""
    ahead = np.arange(count)
    if kind == FROZEN:
        return np.full(count, now - 1), 0.0
    if kind == LOOP:
        length = round(scenes.spread(rng, LOOP_S) * rate_hz)
        return now - length + ahead % length, length / rate_hz
    back = round(scenes.spread(rng, REPLAY_S if kind == REPLAY else BACK_S) * rate_hz)
    if kind == REPLAY:
        return now - back + ahead, back / rate_hz
    assert kind == SPLICE
    length = round(scenes.spread(rng, SPLICE_S) * rate_hz)
    return np.where(ahead < length, now - back + ahead, now + ahead), back / rate_hz


def _blocks(
    feed: DrawnFeed, level: Float32Array, time_s: FloatArray, true_s: FloatArray
) -> list[RowBlock]:
    """Cut a feed into blocks with the delay and jitter of a network."""
    blocks = list(blocks_from_luminance(level, time_s, Header(source=f"bench/{feed.key}")))
    late_s = LATENCY_S + generator(feed.seed, "live arrival").exponential(ARRIVAL_S, len(blocks))
    arrival_s = np.maximum.accumulate(true_s[[b.header.frame_last for b in blocks]] + late_s)
    at_ns = (T0_NS + nanoseconds(float(at_s)) for at_s in arrival_s)
    return [arrived(block, ns) for block, ns in zip(blocks, at_ns, strict=True)]


def watch(feed: DrawnFeed, grids: Path | None) -> tuple[Shown, list[Any]]:
    """Return a feed, and all messages of a monitor in the order of their arrival."""
    shown = _show(feed, grids)
    nominal_hz = shown.stretch.nominal_hz
    stages: tuple[Stage, ...] = (
        make_tracker(TrackSettings(nominal_hz=nominal_hz)),
        make_idle(IdleSettings(nominal_hz=nominal_hz, every_s=IDLE_EVERY_S)),
    )
    # As a live monitor gets them: none at the end of the stream.
    estimates = (
        arrived(estimate, block.header.arrival_time_ns)
        for block in shown.blocks
        for stage in stages
        for estimate in stage.update(block)
    )
    # At equal times in the order of the streams.
    streams = _reference_blocks(shown.stretch, shown.feed_s, feed), shown.blocks, estimates
    return shown, list(heapq.merge(*streams, key=lambda m: m.header.arrival_time_ns))
