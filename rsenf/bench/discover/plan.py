"""Which cases there are."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

from rsenf.bench.discover.outside import OUTSIDE
from rsenf.bench.discover.strengths import APART, LISTED
from rsenf.model.seeds import generator

KINDS = ("one", "none", "outside", "pair")


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
    effects: tuple[str, ...] = tuple(LISTED)

    def cases(self) -> list[Case]:
        """Return all cases, each with a seed of its own, mixed."""
        hidden: list[tuple[str, tuple[str, ...]]] = [
            ("one", (name,)) for name in self.effects for _ in range(self.each)
        ]
        hidden += [("none", ()) for _ in range(self.none)]
        outside = list(OUTSIDE)
        hidden += [("outside", (outside[n % len(outside)],)) for n in range(self.outside)]
        rng = generator(self.first_seed, "pairs")
        pairs = [p for p in combinations(self.effects, 2) if not any(set(p) <= a for a in APART)]
        for n in rng.choice(len(pairs), self.pairs, replace=self.pairs > len(pairs)).tolist():
            hidden.append(("pair", pairs[n]))
        cases = [
            Case(kind, names, self.first_seed + n, self.times, self.duration_s, self.video)
            for n, (kind, names) in enumerate(hidden)
        ]
        # A run that is stopped halfway has something of everything.
        order = generator(self.first_seed, "order").permutation(len(cases))
        return [cases[n] for n in order.tolist()]
