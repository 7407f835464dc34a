"""The clips that a benchmark films: which ones, what each shows, and the grid behind it.

A scene is a wall in a lamp's light, or one without an ENF. The grid's frequency is from measured
data, of which those for fitting constants and those for testing them are disjoint, or a synthetic
path drawn from a seed.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from rsenf.bench.harness import known_names
from rsenf.errors import UsageError
from rsenf.match.series import Grid
from rsenf.messages.schema import FloatArray
from rsenf.model import CaptureModel, GridPath, Light, Scene, Shake, Shutter, synthetic_grid
from rsenf.model.noise import generator
from rsenf.model.parameters import parse_frame_rate
from rsenf.model.video_file import ENCODERS, Codec
from rsenf.reference import read_reference

SIZES = {"240p": (426, 240), "480p": (854, 480), "720p": (1280, 720), "1080p": (1920, 1080)}
LOSSLESS = "lossless"
CODINGS = (LOSSLESS, "150k", "100k", "50k")

# A lamp on the mains; and scenes without an ENF, in which any estimate is a false claim.
LIT = "lit"
NOTHING = ("no_light", "daylight", "anti_flicker", "black", "moving_camera")
# Of the scenes without an ENF, every fourth clip is encoded as well.
CODED_EVERY = 4
# Files of a folder of measured data: a day and nine days of the continental European grid, 1 s a
# sample, and 21 days of a US grid, 2 s a sample.
CE_2022 = "grid_ce_2022-09-17_1s.csv.gz"
CE_2024 = "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz"
US_2022 = "grid_us_60hz_2022-07_2s.npz"
MEASURED = {50.0: CE_2022, 60.0: US_2022}  # by nominal frequency, Hz
MARGIN_S = 4.0
DAY_S = 86400
FIT, TEST = "fit", "test"
REFERENCE_NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # resolution of published values

LAMPS = ("led", "halogen", "incandescent", "cfl", "led_capacitor")  # by seed, in turn
IDLE_RATIO = (0.02, 0.75)  # the paper's cameras: 0.04 to 0.73
EXPOSURE_S = (1 / 4000, 1 / 250)
MEAN_LEVEL, TEXTURE_RATIO, BLACK_LEVEL = (90.0, 140.0), (0.04, 0.12), 10.0
DRIFT_RATIO, DRIFT_S = (0.02, 0.1), (30.0, 300.0)
CLOUDS_RATIO, CLOUDS_S = (0.01, 0.1), (1.0, 10.0)
SHAKE_PX, SHAKE_S = (2.0, 15.0), (0.1, 2.0)
# Clock errors of cameras, Student's t: most within 30 ppm, few up to 100 ppm.
CLOCK_PPM, CLOCK_FREEDOM = 25.0, 4


def codec_of(coding: str) -> Codec | None:
    """Return the codec of a coding such as 150k or vp9-300k; None of a lossless one."""
    if coding == LOSSLESS:
        return None
    name, _, rate = coding.rpartition("-")
    number, name = rate.removesuffix("k"), name or "h264"
    if not number.isdecimal() or number == rate or name not in ENCODERS:
        hint = "lossless, a bit rate of x264 like 150k, or one of another codec like vp9-300k"
        raise UsageError(f"{coding!r} is not a coding", f"write {hint}")
    return Codec(name=name, bitrate_bps=int(number) * 1000)


def check_films(sizes: Sequence[str], codings: Sequence[str]) -> None:
    """Raise UsageError for a size or a coding that can't be meant so."""
    known_names(sizes, SIZES, "size")
    for coding in codings:
        codec_of(coding)


@dataclass(frozen=True)
class SceneClip:
    """One clip of the plan; all its other properties are drawn from its seed and its cell."""

    scene: str  # LIT, or one of NOTHING
    size: str  # of SIZES
    frame_rate: str  # such as 29.97
    nominal_hz: float  # of the grid
    seed: int
    duration_s: float
    codings: tuple[str, ...] = CODINGS

    @property
    def key(self) -> str:
        """Unique name in all plans, by which its record is found."""
        return f"{self._cell} {self.seed} {self.duration_s:g}s {','.join(self.codings)}"

    def generator(self, purpose: str) -> np.random.Generator:
        """Random generator of this clip for a purpose; it depends on the cell and the seed."""
        return generator(self.seed, f"{self._cell} {purpose}")

    @property
    def _cell(self) -> str:
        return f"{self.scene} {self.size} {self.frame_rate}fps {self.nominal_hz:g}Hz"


@dataclass(frozen=True)
class Plan:
    """What to film.

    Parameters
    ----------
    sizes : tuple of str
        Names of sizes, such as 480p.
    frame_rates : tuple of str
        Frames a second.
    nominals_hz : tuple of float
        Grids, 50 or 60.
    codings : tuple of str
        Bit rates, or lossless.
    first_seed : int
        Seed of the first clip.
    clips : int
        Of each cell of lit scenes, and of each scene with nothing to claim.
    duration_s : float
        Length of each clip.
    """

    sizes: tuple[str, ...] = ("480p", "720p")
    frame_rates: tuple[str, ...] = ("23.976", "25", "29.97", "30")
    nominals_hz: tuple[float, ...] = (50.0,)
    codings: tuple[str, ...] = CODINGS
    first_seed: int = 0
    clips: int = 20
    duration_s: float = 60.0

    def __post_init__(self) -> None:
        check_films(self.sizes, self.codings)
        for rate in self.frame_rates:
            parse_frame_rate(rate)

    def lit(self) -> list[SceneClip]:
        """Clips with a lamp on the mains, seed by seed: a stopped run has as many of each cell."""
        cells = product(self._seeds, self.sizes, self.frame_rates, self.nominals_hz)
        return [
            SceneClip(LIT, size, rate, nominal_hz, seed, self.duration_s, self.codings)
            for seed, size, rate, nominal_hz in cells
        ]

    def nothing(self) -> list[SceneClip]:
        """Clips without an ENF, of the first size; frame rates and grids alternate."""
        cells = [(rate, nominal_hz) for nominal_hz in self.nominals_hz for rate in self.frame_rates]
        out = []
        for seed, scene in product(self._seeds, NOTHING):
            codings = self.codings if seed % CODED_EVERY == 0 else self.codings[:1]
            cell = cells[seed % len(cells)]
            out.append(SceneClip(scene, self.sizes[0], *cell, seed, self.duration_s, codings))
        return out

    @property
    def _seeds(self) -> range:
        return range(self.first_seed, self.first_seed + self.clips)


Span = tuple[float, float]  # least and most


def grid_for(
    folder: Path | None, nominal_hz: float, duration_s: float, rng: np.random.Generator
) -> tuple[GridPath, str]:
    """Return a grid's frequency from a random time on, and the name of the grid.

    Parameters
    ----------
    folder : Path or None
        With the files of :data:`MEASURED`; without it, or without its file, the path is synthetic.
    """
    path = folder / MEASURED[nominal_hz] if folder else None
    if path is None or not path.is_file():
        seed = int(rng.integers(2**31))
        return synthetic_grid(seed, duration_s + MARGIN_S, nominal_hz=nominal_hz), "synthetic"
    days = _read(path)
    latest_s = days[0].duration_s - duration_s - MARGIN_S
    if latest_s <= 0:
        raise UsageError(f"{path} is too short for clips of {duration_s:g} s")
    day = days[int(rng.integers(len(days)))]
    start_s = float(rng.uniform(0, latest_s))
    return GridPath(day.freq_hz, day.step_s, start_s, nominal_hz), day.name


@functools.cache
def _read(path: Path) -> tuple[Grid, ...]:
    """Read measured days: of 60 Hz from an archive, or a series of 50 Hz as one."""
    if path.suffix == ".npz":
        with np.load(path, allow_pickle=False) as held:
            step_s, days = float(held["step_s"]), np.asarray(held["frequency"], np.float64)
        return tuple(Grid(path.stem, 60.0, 0, step_s, day) for day in days)
    reference = read_reference(path)
    return (Grid(reference.grid, 50.0, 0, reference.step_s, reference.freq_hz),)


@functools.lru_cache(maxsize=2)
def stretches(folder: Path, part: str) -> tuple[Grid, ...]:
    """Return the measured data for fitting constants, or for testing them.

    ``fit``: the continental European grid of 2024 before 18 August, and the first eleven US days.
    ``test``: a day of the European grid in 2022, and the other ten US days.
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


def stretch_of(folder: Path, part: str, rng: np.random.Generator) -> Grid:
    """Draw measured data of a part: half the first, long one, half one of many short ones."""
    everything = stretches(folder, part)
    other = int(rng.integers(1, len(everything)))
    return everything[0 if rng.random() < 0.5 else other]


def published(freq_hz: FloatArray, noise_hz: float, rng: np.random.Generator) -> FloatArray:
    """Return a grid's frequency as references have it: with noise, and rounded.

    Parameters
    ----------
    freq_hz : ndarray, shape (n,)
    noise_hz : float
        Standard deviation of the noise of a sample.
    """
    return np.asarray(
        np.round((freq_hz + noise_hz * rng.standard_normal(freq_hz.size)) / STEP_HZ) * STEP_HZ
    )


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


def setting_of(clip: SceneClip) -> Setting:
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
    size, frame_rate : str
        Such as 480p and 29.97.
    """
    columns, rows = SIZES[size]
    rate = parse_frame_rate(frame_rate)
    shutter = Shutter(frame_rate=rate, rows=rows, columns=columns, idle_ratio=idle_ratio)
    return CaptureModel(name=name, light=Light(lamp=lamp), shutter=shutter, scene=scene_of(rng))


def scene_of(rng: np.random.Generator) -> Scene:
    """Draw the brightness and the texture of a wall."""
    mean_level, texture_ratio = (float(rng.uniform(*r)) for r in (MEAN_LEVEL, TEXTURE_RATIO))
    return Scene(mean_level=mean_level, texture_ratio=texture_ratio)


def shaken(model: CaptureModel, px: Span, time_s: Span, rng: np.random.Generator) -> CaptureModel:
    """Return a capture by hand, whose shake is drawn.

    Parameters
    ----------
    px, time_s : (float, float)
        Least and most of the shake and of its time constant.
    """
    shake = Shake(shake_px=spread(rng, px), time_constant_s=spread(rng, time_s))
    return replace(model, scene=replace(model.scene, shake=shake))


def with_clock_error(model: CaptureModel, rng: np.random.Generator) -> CaptureModel:
    """Return a capture by a camera whose clock has a drawn error."""
    clock_ppm = CLOCK_PPM * float(rng.standard_t(CLOCK_FREEDOM))
    return model.with_effect("clock_skew", clock_ppm=clock_ppm)


def _unlit(model: CaptureModel, scene: str, rng: np.random.Generator) -> CaptureModel:
    """Remove the flicker, and add disturbances that could be mistaken for it."""
    model = replace(model, light=replace(model.light, flicker_ratio=0.0))
    if scene == "black":
        dark = replace(model.scene, mean_level=BLACK_LEVEL, texture_ratio=0.0)
        return replace(model, scene=dark)
    if scene == "daylight":
        for ratios, times_s in ((DRIFT_RATIO, DRIFT_S), (CLOUDS_RATIO, CLOUDS_S)):
            gain = {"gain_ratio": spread(rng, ratios), "time_constant_s": spread(rng, times_s)}
            model = model.plus(*CaptureModel().with_effect("auto_exposure", **gain).effects)
        return model
    return shaken(model, SHAKE_PX, SHAKE_S, rng) if scene == "moving_camera" else model


def spread(rng: np.random.Generator, low_high: Span) -> float:
    """Draw a log-uniform value between two limits."""
    low, high = low_high
    return math.exp(rng.uniform(math.log(low), math.log(high)))
