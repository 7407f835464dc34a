"""Camera, lamp and clock of a feed, drawn from its seed."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from rsenf.bench.scenes import EXPOSURE_S, MEAN_LEVEL, TEXTURE_RATIO, spread
from rsenf.model import CaptureModel, Light, Scene, Sensor, Shutter
from rsenf.model.seeds import generator
from rsenf.model.wander import wander

FRAME_RATES = (Fraction(24), Fraction(25), Fraction(30000, 1001), Fraction(30))
LAMPS = ("led", "halogen", "incandescent", "cfl")
DAYLIGHT_RATIO = (0.0, 0.8)
# Few lines and narrow ones are cheap; sensors in the dark are noisier by far than those in the sun.
LINES, COLUMNS, WHITE_E = 48, (32.0, 512.0), (500.0, 12000.0)
# Share of the feeds whose codec follows flicker too slowly, and has its phase wander: by as much as
# makes the ENF wrong by 0.1 to 3 mHz over a second, as it is in videos at 150k to 50k.
CODED, GAIN, WANDER_RAD, WANDER_S = 0.5, (0.1, 1.0), (0.005, 0.06), (3.0, 15.0)
IDLE_RATIO = (0.02, 0.6)
# Clocks of cameras: most are within 30 ppm, and now and then one is at 100.
CLOCK_PPM, CLOCK_FREEDOM = 25.0, 4
RAD_PER_S = 2 * math.pi * 100.0  # of flicker, near enough
JITTER_S, GAIN_RATIO, GAIN_S = (1e-6, 3e-5), (5e-4, 5e-3), (1.0, 30.0)


def frame_rate_of(seed: int) -> Fraction:
    """Frame rate of a feed; another camera that takes its place has the same."""
    rng = generator(seed, "live frame rate")
    return FRAME_RATES[int(rng.integers(len(FRAME_RATES)))]


def camera_of(seed: int, length_s: float, which: str = "camera") -> CaptureModel:
    """Draw a camera and what it looks at.

    Parameters
    ----------
    seed : int
        Of the feed.
    length_s : float
        Of what it takes.
    which : str, optional
        Another name is another camera.
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
        "auto_exposure",
        gain_ratio=spread(rng, GAIN_RATIO),
        time_constant_s=spread(rng, GAIN_S),
    )


def _late_s(
    rng: np.random.Generator, length_s: float, rate_hz: float, jitter_s: float, wander_rad: float
) -> tuple[float, ...]:
    """Draw by how much each frame comes late: white, and as if it were, the codec's wander."""
    count = math.ceil(length_s * rate_hz) + 1
    wandering = wander(rng, count, 1 / rate_hz, spread(rng, WANDER_S))
    late_s = jitter_s * rng.standard_normal(count) + wander_rad / RAD_PER_S * wandering
    return tuple(late_s.tolist())
