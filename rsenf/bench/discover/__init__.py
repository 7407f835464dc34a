"""Blind discovery: effects hidden in simulated recordings, and what the workflow says of each.

Here: which cases there are (one effect, several, none, or one that isn't in the catalogue).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations, cycle, islice, starmap

from rsenf.model import CATALOGUE
from rsenf.model.noise import generator

# The order fixes their seeds; later effects of the catalogue come after them.
FIRST = (
    "harmonics", "gamma", "frame_drop", "frame_duplicate", "capture_jitter", "auto_exposure",
    "second_lamp", "pwm_tone", "interharmonic", "gop_attenuation", "row_banding", "readout_drift",
    "variable_frame_rate", "timestamp_jitter", "interlace", "reverse_readout",
)  # fmt: skip


def listed() -> tuple[str, ...]:
    """Return the effects of the catalogue that can be hidden: those with a least size."""
    known = [name for name, effect in CATALOGUE.usable().items() if effect.weakest]
    first = [name for name in FIRST if name in known]
    return (*first, *(name for name in known if name not in first))


def left_out() -> dict[str, str]:
    """Return the other effects of the catalogue, each with the reason why it can't be hidden."""
    return {name: e.not_hidden for name, e in CATALOGUE.usable().items() if not e.weakest}


@dataclass(frozen=True)
class Hidden:
    """A simulated recording, and the effects hidden in it."""

    kind: str  # of :data:`rsenf.bench.discover.table.WHOLE`
    hidden: tuple[str, ...]  # of the catalogue or not
    seed: int
    times: float  # strength, over the weakest that is to be named
    duration_s: float
    video: bool = False  # encoded and decoded; else the row means of the sensor
    rows: int = 0  # of a foreign camera's pictures; rsenf's own model draws them

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        camera = f"foreign {self.rows} " if self.rows else ""
        what = f"{self.kind} {'+'.join(self.hidden) or 'nothing'} ×{self.times:g}"
        depth = "video" if self.video else "rows"
        return f"{camera}{depth} {what} {self.duration_s:g}s seed {self.seed}"


@dataclass(frozen=True)
class Hideable:
    """What a camera can hide, by name."""

    effects: tuple[str, ...]  # of the catalogue
    unknown: tuple[str, ...]  # in no catalogue
    physical: tuple[str, ...]  # physical programs, which are to be described
    neutral: tuple[str, ...]  # no discrepancies, hidden in some cases with nothing else
    never: dict[str, str]  # others, each with the reason why it is never hidden
    go_together: Callable[[str, str], bool]  # whether two can be hidden at once

    @property
    def kinds(self) -> dict[str, str]:
        """The kind of a case of each by itself."""
        by_kind = ("one", self.effects), ("unknown", self.unknown), ("physical", self.physical)
        return {name: kind for kind, names in by_kind for name in names}


@dataclass(frozen=True, kw_only=True)
class CasePlan:
    """How many cases of each kind, from which seed on.

    Parameters
    ----------
    first_seed : int
        Seed of the first case.
    each : int
        Of each effect of the catalogue that is listed.
    none : int
        With nothing hidden.
    outside : int
        Of a foreign camera with what is in no catalogue.
    pairs : int
        With two effects.
    triples : int
        Of a foreign camera with three effects.
    times : float
        Strength, over the weakest that is to be named.
    duration_s : float
        Of each recording; 30 s of video.
    video : bool
        Filmed, encoded and decoded.
    rows : int
        Of a foreign camera's pictures.
    effects : tuple of str
        Those to hide.
    """

    first_seed: int = 0
    each: int = 20
    none: int = 100
    outside: int = 40
    pairs: int = 40
    triples: int = 20
    times: float = 3.0
    duration_s: float = 60.0
    video: bool = False
    rows: int = 720
    effects: tuple[str, ...] = field(default_factory=listed)

    def cases(self, camera: Hideable | None = None) -> list[Hidden]:
        """Return all cases of a camera in random order, each with a seed of its own."""
        own = camera is None
        camera = camera or Hideable(
            listed(), (), (), (), left_out(),
            lambda a, b: b not in CATALOGUE[a].never_with and a not in CATALOGUE[b].never_with,
        )  # fmt: skip
        each = [(camera.kinds[name], (name,)) for name in self.effects]
        hidden: list[tuple[str, tuple[str, ...]]] = [one for one in each for _ in range(self.each)]
        nothing: list[tuple[str, ...]] = [(), (), (), *((name,) for name in camera.neutral)]
        hidden += [("none", names) for names in islice(cycle(nothing), self.none)]
        hidden += [("unknown", (name,)) for name in islice(cycle(camera.unknown), self.outside)]
        together = [name for name in self.effects if name not in camera.physical]
        sizes = [("pair", 2, self.pairs)] + ([] if own else [("triple", 3, self.triples)])
        for kind, size, count in sizes:
            groups = list(combinations(together, size))
            groups = [g for g in groups if all(starmap(camera.go_together, combinations(g, 2)))]
            # None twice if there are enough.
            rng, wanted = generator(self.first_seed, kind), count if groups else 0
            drawn = rng.choice(max(len(groups), 1), wanted, replace=wanted > len(groups))
            hidden += [(kind, groups[n]) for n in drawn.tolist()]
        rows = 0 if own else self.rows
        cases = [
            Hidden(kind, names, self.first_seed + n, self.times, self.duration_s, self.video, rows)
            for n, (kind, names) in enumerate(hidden)
        ]
        order = generator(self.first_seed, "order").permutation(len(cases))
        return [cases[n] for n in order.tolist()]
