"""The scene of a clip: a wall in a lamp's light, or a scene without an ENF."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rsenf.bench.plan import LIT, SIZES, Clip
from rsenf.model import CaptureModel, Light, Scene, Shake, Shutter, parse_frame_rate

# By seed, in turn.
LAMPS = ("led", "halogen", "incandescent", "cfl", "led_capacitor")

IDLE_RATIO = (0.02, 0.75)  # the paper's cameras: 0.04 to 0.73
EXPOSURE_S = (1 / 4000, 1 / 250)
MEAN_LEVEL = (90.0, 140.0)
TEXTURE_RATIO = (0.04, 0.12)

BLACK_LEVEL = 10.0
DRIFT_RATIO, DRIFT_S = (0.02, 0.1), (30.0, 300.0)
CLOUDS_RATIO, CLOUDS_S = (0.01, 0.1), (1.0, 10.0)
SHAKE_PX, SHAKE_S = (2.0, 15.0), (0.1, 2.0)


@dataclass(frozen=True)
class Setting:
    """The simulated capture of a clip.

    Parameters
    ----------
    model : CaptureModel
    seed : int
        Of the simulation.
    exposure_s : float
        Exposure time of a row.
    """

    model: CaptureModel
    seed: int
    exposure_s: float

    def flicker_levels(self, nominal_hz: float) -> list[float]:
        """Amplitudes of the flicker's harmonics in the row means, 8-bit levels.

        An exposure of length ``T`` attenuates a harmonic at ``f`` by ``sinc(f·T)``.
        """
        f0_hz = 2 * nominal_hz
        series = np.abs(self.model.light.series(f0_hz)) * self.model.scene.level
        order = np.arange(1, series.size + 1)
        return np.abs(series * np.sinc(order * f0_hz * self.exposure_s)).tolist()  # type: ignore[no-any-return]  # a list of floats


def setting_of(clip: Clip) -> Setting:
    """Draw the capture of a clip from its seed."""
    rng = clip.generator("scene")
    lamp, idle_ratio = LAMPS[clip.seed % len(LAMPS)], float(rng.uniform(*IDLE_RATIO))
    model = wall(clip.key, lamp, clip.size, clip.frame_rate, idle_ratio, rng)
    exposure_s = spread(rng, EXPOSURE_S)
    seed = int(rng.integers(2**31))
    if clip.scene == "anti_flicker":
        exposure_s = 1 / (2 * clip.nominal_hz)
    elif clip.scene != LIT:
        model = _unlit(model, clip.scene, rng)
    model = model.with_effect("exposure", exposure_s=exposure_s)
    return Setting(model, seed, exposure_s)


def wall(
    name: str, lamp: str, size: str, frame_rate: str, idle_ratio: float, rng: np.random.Generator
) -> CaptureModel:
    """Return the capture of a wall in a lamp's light; brightness and texture are drawn.

    Parameters
    ----------
    name : str
        Of the model.
    lamp : str
    size : str
        Of :data:`rsenf.bench.plan.SIZES`.
    frame_rate : str
        Such as 29.97.
    idle_ratio : float
    rng : numpy.random.Generator
    """
    columns, rows = SIZES[size]
    return CaptureModel(
        name=name,
        light=Light(lamp=lamp),
        shutter=Shutter(
            frame_rate=parse_frame_rate(frame_rate),
            rows=rows,
            columns=columns,
            idle_ratio=idle_ratio,
        ),
        scene=Scene(
            mean_level=float(rng.uniform(*MEAN_LEVEL)),
            texture_ratio=float(rng.uniform(*TEXTURE_RATIO)),
        ),
    )


def _unlit(model: CaptureModel, scene: str, rng: np.random.Generator) -> CaptureModel:
    """Remove the flicker, and add disturbances that could be mistaken for it."""
    model = replace(model, light=replace(model.light, flicker_ratio=0.0))
    if scene == "black":
        dark = replace(model.scene, mean_level=BLACK_LEVEL, texture_ratio=0.0)
        return replace(model, scene=dark)
    if scene == "daylight":
        drift = CaptureModel().with_effect(
            "auto_exposure", gain_ratio=spread(rng, DRIFT_RATIO),
            time_constant_s=spread(rng, DRIFT_S),
        )  # fmt: skip
        clouds = CaptureModel().with_effect(
            "auto_exposure", gain_ratio=spread(rng, CLOUDS_RATIO),
            time_constant_s=spread(rng, CLOUDS_S),
        )  # fmt: skip
        return model.plus(*drift.effects, *clouds.effects)
    if scene == "moving_camera":
        shake = Shake(shake_px=spread(rng, SHAKE_PX), time_constant_s=spread(rng, SHAKE_S))
        return replace(model, scene=replace(model.scene, shake=shake))
    return model


def spread(rng: np.random.Generator, low_high: tuple[float, float]) -> float:
    """Draw a log-uniform value between two limits."""
    low, high = low_high
    return math.exp(rng.uniform(math.log(low), math.log(high)))
