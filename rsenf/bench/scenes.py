"""The scene of a clip: a wall in a lamp's light, or one without an ENF; and the grid behind it.

The grid's frequency is from measured data, of which those for fitting constants and those for
testing them are disjoint, or a synthetic path drawn from a seed.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsenf.bench.plan import LIT, SIZES, Clip
from rsenf.errors import UsageError
from rsenf.messages.schema import FloatArray
from rsenf.model import (
    CaptureModel,
    GridPath,
    Light,
    Scene,
    Shake,
    Shutter,
    parse_frame_rate,
    synthetic_grid,
)
from rsenf.reference import read_reference

# Files of a folder of measured data: a day and nine days of the continental European grid, 1 s a
# sample, and 21 days of a US grid, 2 s a sample.
CE_2022 = "grid_ce_2022-09-17_1s.csv.gz"
CE_2024 = "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz"
US_2022 = "grid_us_60hz_2022-07_2s.npz"
MEASURED = {50.0: CE_2022, 60.0: US_2022}  # by nominal frequency, Hz
MARGIN_S = 4.0


@dataclass(frozen=True, eq=False)
class Stretch:
    """Consecutive samples of a grid; NaN in gaps."""

    name: str
    nominal_hz: float
    step_s: float
    freq_hz: FloatArray


def grid_for(
    folder: Path | None, nominal_hz: float, duration_s: float, rng: np.random.Generator
) -> tuple[GridPath, str]:
    """Return a grid's frequency from a random time on, and the name of the grid.

    Parameters
    ----------
    folder : Path or None
        With the files of :data:`MEASURED`; without it, or without its file, the path is synthetic.
    nominal_hz : float
    duration_s : float
        Of the clip.
    rng : numpy.random.Generator

    Raises
    ------
    UsageError
        When a day of the data is shorter than the clip.
    """
    path = folder / MEASURED[nominal_hz] if folder else None
    if path is None or not path.is_file():
        seed = int(rng.integers(2**31))
        return synthetic_grid(seed, duration_s + MARGIN_S, nominal_hz=nominal_hz), "synthetic"
    days = _read(path)
    latest_s = days[0].freq_hz.size * days[0].step_s - duration_s - MARGIN_S
    if latest_s <= 0:
        raise UsageError(f"{path} is too short for clips of {duration_s:g} s")
    day = days[int(rng.integers(len(days)))]
    start_s = float(rng.uniform(0, latest_s))
    return GridPath(day.freq_hz, day.step_s, start_s, nominal_hz), day.name


@functools.cache
def _read(path: Path) -> tuple[Stretch, ...]:
    """Read measured days: of 60 Hz from an archive, or a series of 50 Hz as one."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as held:
            step_s, freq_hz = float(held["step_s"]), np.asarray(held["frequency"], np.float64)
        return tuple(Stretch(path.stem, 60.0, step_s, day) for day in freq_hz)
    reference = read_reference(path)
    return (Stretch(reference.grid, 50.0, reference.step_s, reference.freq_hz),)


DAY_S = 86400
FIT, TEST = "fit", "test"


@functools.lru_cache(maxsize=2)
def stretches(folder: Path, part: str) -> tuple[Stretch, ...]:
    """Return the measured data of a part.

    ``fit``: the continental European grid of 2024 before 18 August, and the first eleven US days.
    ``test``: a day of the European grid in 2022, and the other ten US days.

    Parameters
    ----------
    folder : Path
        Of the measured data.
    part : {'fit', 'test'}

    Raises
    ------
    UsageError
        When the folder doesn't exist.
    """
    if not folder.is_dir():
        raise UsageError(f"no measured grids in {folder}", "name their folder with --grids")
    us = [replace(day, name=f"us-{i}") for i, day in enumerate(_read(folder / US_2022))]
    if part == TEST:
        (day,) = _read(folder / CE_2022)
        return (replace(day, name="ce-2022"), *us[11:])
    (days,) = _read(folder / CE_2024)
    # From 13 August 23:07:33 UTC on; the first 2.5 days are mostly gaps.
    begin, end = int(2.5 * DAY_S), 4 * DAY_S
    return (replace(days, name="ce-2024", freq_hz=days.freq_hz[begin:end]), *us[:11])


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
    """The simulated capture of a clip."""

    model: CaptureModel
    seed: int  # of the simulation
    exposure_s: float  # of a row

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
        for ratio, time_s in ((DRIFT_RATIO, DRIFT_S), (CLOUDS_RATIO, CLOUDS_S)):
            gain = CaptureModel().with_effect(
                "auto_exposure", gain_ratio=spread(rng, ratio), time_constant_s=spread(rng, time_s)
            )
            model = model.plus(*gain.effects)
        return model
    if scene == "moving_camera":
        shake = Shake(shake_px=spread(rng, SHAKE_PX), time_constant_s=spread(rng, SHAKE_S))
        return replace(model, scene=replace(model.scene, shake=shake))
    return model


def spread(rng: np.random.Generator, low_high: tuple[float, float]) -> float:
    """Draw a log-uniform value between two limits."""
    low, high = low_high
    return math.exp(rng.uniform(math.log(low), math.log(high)))
