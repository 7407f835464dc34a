"""The clips that a benchmark films: cells of size, frame rate and grid, and seeds in each."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np

from rsenf.errors import UsageError
from rsenf.model import Codec, parse_frame_rate
from rsenf.model.video_file import ENCODERS

T = TypeVar("T")

SIZES = {"240p": (426, 240), "480p": (854, 480), "720p": (1280, 720), "1080p": (1920, 1080)}
LOSSLESS = "lossless"
CODINGS = (LOSSLESS, "150k", "100k", "50k")

# A lamp on the mains; and scenes without an ENF, in which any estimate is a false claim.
LIT = "lit"
NOTHING = ("no_light", "daylight", "anti_flicker", "black", "moving_camera")
# Of the scenes without an ENF, every fourth clip is encoded as well.
CODED_EVERY = 4


def codec_of(coding: str) -> Codec | None:
    """Return the codec of a coding such as 150k or vp9-300k; None of a lossless one.

    Raises
    ------
    UsageError
        For any other text.
    """
    if coding == LOSSLESS:
        return None
    name, _, rate = coding.rpartition("-")
    number, name = rate.removesuffix("k"), name or "h264"
    if not number.isdecimal() or number == rate or name not in ENCODERS:
        raise UsageError(
            f"{coding!r} is not a coding",
            "write lossless, a bit rate of x264 like 150k, or one of another codec like vp9-300k",
        )
    return Codec(name=name, bitrate_bps=int(number) * 1000)


def check_films(sizes: Sequence[str], codings: Sequence[str]) -> None:
    """Raise UsageError for a size or a coding that can't be meant so."""
    for size in sizes:
        if size not in SIZES:
            raise UsageError(f"no size {size!r}", f"one of {', '.join(SIZES)}")
    for coding in codings:
        codec_of(coding)


@dataclass(frozen=True)
class Clip:
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
        codings = ",".join(self.codings)
        return f"{self._cell} {self.seed} {self.duration_s:g}s {codings}"

    def generator(self, purpose: str) -> np.random.Generator:
        """Random generator of this clip for a purpose; it depends on the cell and the seed."""
        return np.random.default_rng([self.seed, zlib.crc32(f"{self._cell} {purpose}".encode())])

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

    def lit(self) -> list[Clip]:
        """Clips with a lamp on the mains, seed by seed: a stopped run has as many of each cell."""
        cells = list(product(self.sizes, self.frame_rates, self.nominals_hz))
        return [
            Clip(LIT, size, rate, nominal_hz, seed, self.duration_s, self.codings)
            for seed in self._seeds()
            for size, rate, nominal_hz in cells
        ]

    def nothing(self) -> list[Clip]:
        """Clips without an ENF, of the first size; frame rates and grids alternate."""
        return [
            Clip(
                scene,
                self.sizes[0],
                _turn(self.frame_rates, seed),
                _turn(self.nominals_hz, seed // len(self.frame_rates)),
                seed,
                self.duration_s,
                self.codings if seed % CODED_EVERY == 0 else self.codings[:1],
            )
            for seed, scene in product(self._seeds(), NOTHING)
        ]

    def _seeds(self) -> Iterator[int]:
        return iter(range(self.first_seed, self.first_seed + self.clips))


def _turn(values: Sequence[T], n: int) -> T:
    return values[n % len(values)]
