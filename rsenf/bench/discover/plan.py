"""Which cases there are."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

from rsenf.bench.discover.outside import OUTSIDE
from rsenf.model import CATALOGUE
from rsenf.model.seeds import generator

KINDS = ("one", "none", "outside", "pair")
# Their seeds are of this order; whatever joins the catalogue comes after them.
FIRST = (
    "harmonics", "gamma", "frame_drop", "frame_duplicate", "capture_jitter", "auto_exposure",
    "second_lamp", "pwm_tone", "interharmonic", "gop_attenuation", "row_banding", "readout_drift",
    "variable_frame_rate", "timestamp_jitter", "interlace", "reverse_readout",
)  # fmt: skip


def listed() -> tuple[str, ...]:
    """Effects of the catalogue that can be hidden: those that say how weak they may be."""
    known = [name for name, effect in CATALOGUE.usable().items() if effect.weakest]
    first = [name for name in FIRST if name in known]
    return (*first, *(name for name in known if name not in first))


def left_out() -> dict[str, str]:
    """Return the other effects, each with the reason why it can't be hidden."""
    return {name: e.not_hidden for name, e in CATALOGUE.usable().items() if not e.weakest}


@dataclass(frozen=True)
class Case:
    """A recording to be made, and what is hidden in it.

    Attributes
    ----------
    kind : str
        One of :data:`KINDS`.
    hidden : tuple of str
        Names of what is hidden, of the catalogue or of :data:`OUTSIDE`.
    seed : int
    times : float
        Strength, over the weakest that is to be named.
    duration_s : float
    video : bool
        Filmed, encoded and decoded; else row means as they leave the sensor.
    """

    kind: str
    hidden: tuple[str, ...]
    seed: int
    times: float
    duration_s: float
    video: bool

    @property
    def key(self) -> str:
        """Name that tells it from any other."""
        depth = "video" if self.video else "rows"
        what = "+".join(self.hidden) or "nothing"
        return f"{depth} {self.kind} {what} ×{self.times:g} {self.duration_s:g}s seed {self.seed}"


@dataclass(frozen=True, kw_only=True)
class Plan:
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
        With what is in no catalogue.
    pairs : int
        With two effects.
    times : float
        Strength, over the weakest that is to be named.
    duration_s : float
        Of each recording; 30 s of video.
    video : bool
        Filmed, encoded and decoded.
    effects : tuple of str
        Those to hide.
    """

    first_seed: int = 0
    each: int = 20
    none: int = 100
    outside: int = 40
    pairs: int = 40
    times: float = 3.0
    duration_s: float = 60.0
    video: bool = False
    effects: tuple[str, ...] = field(default_factory=listed)

    def cases(self) -> list[Case]:
        """Return all cases, each with a seed of its own, mixed."""
        hidden: list[tuple[str, tuple[str, ...]]] = [
            ("one", (name,)) for name in self.effects for _ in range(self.each)
        ]
        hidden += [("none", ()) for _ in range(self.none)]
        outside = list(OUTSIDE)
        hidden += [("outside", (outside[n % len(outside)],)) for n in range(self.outside)]
        rng = generator(self.first_seed, "pairs")
        pairs = [p for p in combinations(self.effects, 2) if _go_together(*p)]
        drawn = self.pairs if pairs else 0
        for n in rng.choice(max(len(pairs), 1), drawn, replace=drawn > len(pairs)).tolist():
            hidden.append(("pair", pairs[n]))
        cases = [
            Case(kind, names, self.first_seed + n, self.times, self.duration_s, self.video)
            for n, (kind, names) in enumerate(hidden)
        ]
        # A run that is stopped halfway has something of everything.
        order = generator(self.first_seed, "order").permutation(len(cases))
        return [cases[n] for n in order.tolist()]


def _go_together(one: str, other: str) -> bool:
    return not (other in CATALOGUE[one].never_with or one in CATALOGUE[other].never_with)
