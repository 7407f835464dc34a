"""Time of recording: films cut into clips, and every matcher on every clip.

Here: which films there are, still and moving ones, by two cameras under three lamps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.bench.scenes import LOSSLESS, check_films
from rsenf.errors import UsageError
from rsenf.model.noise import generator

FRAME_RATE = "29.97"
NOMINAL_HZ = 50.0
STILL, MOVING = KINDS = ("still", "moving")
# As in the paper: two cameras, three lamps.
CAMERAS = 2
LAMPS = ("led", "halogen", "cfl")
ROUND = len(KINDS) * CAMERAS * len(LAMPS)
# The paper's bit rates of x264, and VP9 as of video sites.
CODINGS = (LOSSLESS, "150k", "100k", "50k", "vp9-300k")
DAY_S = 86400.0


@dataclass(frozen=True)
class PlannedFilm:
    """One film of the plan; its other properties are drawn from its seed and its camera."""

    kind: str  # of KINDS
    camera: int  # the seed of its idle ratio and clock error
    lamp: str
    seed: int
    size: str = "720p"
    duration_s: float = 600.0
    reference_s: float = DAY_S  # the part of a day that is searched
    codings: tuple[str, ...] = CODINGS

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        drawn = f"{self.kind}-{self.lamp}-camera{self.camera}-{self.seed}-{self.size}"
        return f"{drawn}-{self.duration_s:g}s-in-{self.reference_s:g}s-{'+'.join(self.codings)}"

    def generator(self, purpose: str) -> np.random.Generator:
        """Random generator of this film for a purpose."""
        return generator(self.seed, f"{self.kind} {purpose}")

    def camera_generator(self) -> np.random.Generator:
        """Random generator of its camera, the same in all its films."""
        return generator(self.camera, "camera")


@dataclass(frozen=True)
class RecordingPlan:
    """What to film.

    Parameters
    ----------
    size : str
        Of all films, such as 480p.
    codings : tuple of str
        Bit rates, or lossless.
    first_seed, clips : int
        Seeds and number of the films. Still and moving ones take turns, and so do cameras and
        lamps, so that a run that is stopped is even; after :data:`ROUND` films there are new
        cameras.
    duration_s, reference_s : float
        Of a film, and of what it is searched for in.
    """

    size: str = "720p"
    codings: tuple[str, ...] = CODINGS
    first_seed: int = 0
    clips: int = ROUND
    duration_s: float = 600.0
    reference_s: float = DAY_S

    def __post_init__(self) -> None:
        check_films([self.size], self.codings)
        if self.duration_s > self.reference_s / 2:
            what = f"films of {self.duration_s:g} s in a reference of {self.reference_s:g} s"
            raise UsageError(what, "shorten the films")

    def films(self) -> list[PlannedFilm]:
        """Return the films in the order of the run."""
        same = self.size, self.duration_s, self.reference_s, self.codings
        out = []
        for n in range(self.clips):
            pair, seed = n // len(KINDS), self.first_seed
            camera = seed + n // ROUND * CAMERAS + pair % CAMERAS
            lamp = LAMPS[pair % len(LAMPS)]
            out.append(PlannedFilm(KINDS[n % len(KINDS)], camera, lamp, seed + n, *same))
        return out
