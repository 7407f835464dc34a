"""The grid, camera, lamp and clock of a feed, and the reference that a monitor receives."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np

from rsenf.bench.scenes import EXPOSURE_S, MEAN_LEVEL, TEXTURE_RATIO, Stretch, spread, stretches
from rsenf.messages import Header, ReferenceBlock
from rsenf.model import CaptureModel, GridPath, Light, Scene, Sensor, Shutter, synthetic_grid
from rsenf.model.noise import generator, wander
from rsenf.timebase import nanoseconds

PAST_S = 3600.0  # of reference before the feed
MARGIN_S = 30.0
NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # resolution of published values
LATE_S = 0.5  # delay of a reference sample after its end
_SYNTHETIC_S = 3 * 3600.0
# Host's clock at the first sample of the grid.
T0_NS = 1_767_225_600 * 10**9


@dataclass(frozen=True, eq=False)
class Watched:
    """A grid's frequency, and the starts of footage and feed in it, s."""

    stretch: Stretch
    footage_s: float
    feed_s: float

    def path(self, start_s: float) -> GridPath:
        """Return the grid's frequency from a camera's start on."""
        of = self.stretch
        return GridPath(of.freq_hz, of.step_s, start_s, of.nominal_hz)


def watched_grid(
    folder: Path | None, part: str, seed: int, lead_s: float, length_s: float
) -> Watched:
    """Draw the grid and the time of a feed.

    Parameters
    ----------
    folder : Path or None
        Of the measured data; without it, the grid is synthetic.
    part : {'fit', 'test'}
    seed : int
        Of the feed.
    lead_s, length_s : float
        Of footage before the feed, and of the feed.
    """
    rng = generator(seed, f"live grid {part}")
    before_s, after_s = max(PAST_S, lead_s) + MARGIN_S, length_s + MARGIN_S
    if folder is None:
        drawn, nominal_hz = int(rng.integers(2**31)), float(rng.choice([50.0, 60.0]))
        path = synthetic_grid(drawn, _SYNTHETIC_S, nominal_hz=nominal_hz)
        stretch = Stretch("synthetic", nominal_hz, path.step_s, path.freq_hz)
    else:
        everything = stretches(folder, part)
        # Half of the feeds are in the first stretch, a long one; the others are many short ones.
        other = int(rng.integers(1, len(everything)))
        stretch = everything[0 if rng.random() < 0.5 else other]
    while True:
        at_s = float(rng.uniform(before_s, stretch.freq_hz.size * stretch.step_s - after_s))
        first, last = (int((at_s + s) / stretch.step_s) for s in (-lead_s - MARGIN_S, after_s))
        if np.isfinite(stretch.freq_hz[first:last]).all():
            return Watched(stretch, at_s - lead_s, at_s)


def reference_blocks(watched: Watched, length_s: float, seed: int) -> Iterator[ReferenceBlock]:
    """Yield the reference as it arrives, with noise and rounded: the past, then sample by sample.

    Parameters
    ----------
    watched : Watched
    length_s : float
        Of the feed.
    seed : int
        Of the noise.
    """
    of = watched.stretch
    begin = int((watched.feed_s - PAST_S) / of.step_s)
    now = int(watched.feed_s / of.step_s)
    end = int((watched.feed_s + length_s) / of.step_s) + 1
    noisy = of.freq_hz[begin:end]
    noise_hz = NOISE_HZ / np.sqrt(of.step_s)
    noisy = noisy + noise_hz * generator(seed, "live reference").standard_normal(noisy.size)
    freq_hz = np.round(noisy / STEP_HZ) * STEP_HZ
    step_ns = nanoseconds(of.step_s)
    t0_ns = T0_NS + begin * step_ns
    cuts = [0, *range(now - begin, end - begin + 1)]
    for seq, (first, stop) in enumerate(pairwise(cuts)):
        yield ReferenceBlock(
            header=Header(
                source=f"reference/{of.name}",
                seq=seq,
                pts_ns=first * step_ns,
                arrival_time_ns=t0_ns + stop * step_ns + nanoseconds(LATE_S),
            ),
            grid=of.name,
            nominal_hz=of.nominal_hz,
            t0_ns=t0_ns,
            step_ns=step_ns,
            first=first,
            samples=stop - first,
            total=0,
            freq_hz=freq_hz[first:stop],
            readings=np.isfinite(freq_hz[first:stop]).astype(np.uint32),
        )


FRAME_RATES = (Fraction(24), Fraction(25), Fraction(30000, 1001), Fraction(30))
LAMPS = ("led", "halogen", "incandescent", "cfl")
DAYLIGHT_RATIO = (0.0, 0.8)
# Few rows and columns save time; full-well capacities are of dim to bright scenes.
LINES, COLUMNS, WHITE_E = 48, (32.0, 512.0), (500.0, 12000.0)
# Share of encoded feeds, attenuation of flicker, and wander of its phase: an error of the ENF of
# 0.1 to 3 mHz over a second, as in videos at 150k to 50k.
CODED, GAIN, WANDER_RAD, WANDER_S = 0.5, (0.1, 1.0), (0.005, 0.06), (3.0, 15.0)
IDLE_RATIO = (0.02, 0.6)
# Clock errors of cameras, Student's t: most within 30 ppm, few up to 100 ppm.
CLOCK_PPM, CLOCK_FREEDOM = 25.0, 4
RAD_PER_S = 2 * math.pi * 100.0  # of the flicker, approximately
JITTER_S, GAIN_RATIO, GAIN_S = (1e-6, 3e-5), (5e-4, 5e-3), (1.0, 30.0)


def frame_rate_of(seed: int) -> Fraction:
    """Return the frame rate of a feed, also of another camera that replaces it."""
    return FRAME_RATES[int(generator(seed, "live frame rate").integers(len(FRAME_RATES)))]


def camera_of(seed: int, length_s: float, which: str = "camera") -> CaptureModel:
    """Draw a camera and its scene.

    Parameters
    ----------
    seed : int
        Of the feed.
    length_s : float
        Of its footage.
    which : str, optional
        Each name is a camera of its own.
    """
    rng = generator(seed, f"live {which}")
    model = CaptureModel(
        name=f"{which} {seed}",
        light=Light(
            lamp=str(rng.choice(LAMPS)), daylight_ratio=float(rng.uniform(*DAYLIGHT_RATIO))
        ),
        shutter=Shutter(
            frame_rate=frame_rate_of(seed),
            rows=LINES,
            columns=round(spread(rng, COLUMNS)),
            idle_ratio=float(rng.uniform(*IDLE_RATIO)),
        ),
        sensor=Sensor(white_e=spread(rng, WHITE_E)),
        scene=Scene(
            mean_level=float(rng.uniform(*MEAN_LEVEL)),
            texture_ratio=float(rng.uniform(*TEXTURE_RATIO)),
        ),
    )
    model = model.with_effect("exposure", exposure_s=spread(rng, EXPOSURE_S))
    clock_ppm = CLOCK_PPM * float(rng.standard_t(CLOCK_FREEDOM))
    model = model.with_effect("clock_skew", clock_ppm=clock_ppm)
    jitter_s, wander_rad = spread(rng, JITTER_S), 0.0
    if rng.random() < CODED:
        model = model.with_effect("codec_lowpass", gain=spread(rng, GAIN))
        wander_rad = spread(rng, WANDER_RAD)
    late_s = _late_s(rng, length_s, float(model.shutter.frame_rate), jitter_s, wander_rad)
    model = model.with_effect("capture_jitter", late_s=late_s)
    return model.with_effect(
        "auto_exposure", gain_ratio=spread(rng, GAIN_RATIO), time_constant_s=spread(rng, GAIN_S)
    )


def _late_s(
    rng: np.random.Generator, length_s: float, rate_hz: float, jitter_s: float, wander_rad: float
) -> tuple[float, ...]:
    """Draw the delay of each frame, s: white jitter, and one that has the codec's phase wander."""
    count = math.ceil(length_s * rate_hz) + 1
    wandering = wander(rng, count, 1 / rate_hz, spread(rng, WANDER_S))
    late_s = jitter_s * rng.standard_normal(count) + wander_rad / RAD_PER_S * wandering
    return tuple(late_s.tolist())
