"""What a film shows: a wall in a lamp's light; in the moving ones somebody passes, hand-held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rsenf.bench.plan import SIZES
from rsenf.bench.recording_time.plan import FRAME_RATE, MOVING, Film
from rsenf.bench.scenes import EXPOSURE_S, IDLE_RATIO, MEAN_LEVEL, TEXTURE_RATIO, Setting, spread
from rsenf.model import CaptureModel, Light, Scene, Shake, Shutter, parse_frame_rate

# Clocks of cameras: most are within 30 ppm, and now and then one is at 70.
CLOCK_PPM, CLOCK_FREEDOM = 25.0, 4

WIDTH_RATIO, HEIGHT_RATIO, TOP_RATIO = (0.1, 0.3), (0.3, 0.7), (0.0, 0.5)
PERIOD_S, LEVEL_RATIO = (4.0, 20.0), (0.5, 1.3)
SHAKE_PX, SHAKE_S = (0.1, 0.6), (0.1, 0.5)


def setting_of(film: Film) -> Setting:
    """Draw the capture of a film from its camera and its seed."""
    camera, rng = film.camera_generator(), film.generator("scene")
    columns, rows = SIZES[film.size]
    model = CaptureModel(
        name=film.key,
        light=Light(lamp=film.lamp),
        shutter=Shutter(
            frame_rate=parse_frame_rate(FRAME_RATE),
            rows=rows,
            columns=columns,
            idle_ratio=float(camera.uniform(*IDLE_RATIO)),
        ),
        scene=Scene(
            mean_level=float(rng.uniform(*MEAN_LEVEL)),
            texture_ratio=float(rng.uniform(*TEXTURE_RATIO)),
        ),
    )
    exposure_s = spread(rng, EXPOSURE_S)
    seed = int(rng.integers(2**31))
    clock_ppm = CLOCK_PPM * float(camera.standard_t(CLOCK_FREEDOM))
    model = model.with_effect("exposure", exposure_s=exposure_s)
    model = model.with_effect("clock_skew", clock_ppm=clock_ppm)
    return Setting(_moving(model, rng) if film.kind == MOVING else model, seed, exposure_s)


def _moving(model: CaptureModel, rng: np.random.Generator) -> CaptureModel:
    """Have something pass in front of the wall, and the camera held by hand."""
    shake = Shake(shake_px=spread(rng, SHAKE_PX), time_constant_s=spread(rng, SHAKE_S))
    held = replace(model, scene=replace(model.scene, shake=shake))
    return held.with_effect(
        "moving_object",
        width_ratio=float(rng.uniform(*WIDTH_RATIO)),
        height_ratio=float(rng.uniform(*HEIGHT_RATIO)),
        top_ratio=float(rng.uniform(*TOP_RATIO)),
        period_s=spread(rng, PERIOD_S),
        level_ratio=float(rng.uniform(*LEVEL_RATIO)),
    )
