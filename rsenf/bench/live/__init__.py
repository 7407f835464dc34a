"""The live verdict on honest and manipulated feeds: detection delay and false alarms.

Here: which feeds there are, honest ones, and one kind of attack each.
"""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.errors import UsageError
from rsenf.model.noise import generator

HONEST, FROZEN, LOOP, SPLICE, REPLAY, OTHER = KINDS = (
    "honest", "frozen", "loop", "splice", "replay", "other_camera",
)  # fmt: skip
ATTACKS = KINDS[1:]
# Honest feeds in a round, and one attack of each kind: rare false alarms take hours to measure.
HONEST_EACH = 4
ROUND = HONEST_EACH + len(ATTACKS)
BEGIN_S = (180.0, 420.0)  # start of an attack
LAST_S = 180.0  # observation of an attack


@dataclass(frozen=True)
class DrawnFeed:
    """A feed; all its other properties are drawn from its seed."""

    kind: str  # of KINDS
    part: str  # of the measured grids: see :mod:`rsenf.bench.scenes`
    seed: int
    duration_s: float  # if honest; others last until the end of the attack's observation

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
        return f"{self.part}-{self.kind}-{self.seed}-{self.duration_s:g}s"

    @property
    def attack_s(self) -> float | None:
        """Time of the first false frame, s; None of an honest feed."""
        if self.kind == HONEST:
            return None
        return float(generator(self.seed, "live attack begins").uniform(*BEGIN_S))

    @property
    def length_s(self) -> float:
        """Length of the feed, s."""
        attack_s = self.attack_s
        return self.duration_s if attack_s is None else attack_s + LAST_S


@dataclass(frozen=True, kw_only=True)
class LivePlan:
    """How many feeds, from which seed on.

    Kinds take turns, so that a run that is stopped is even.

    Parameters
    ----------
    part : {'fit', 'test'}
    first_seed : int
        Seed of the first feed.
    clips : int
        Number of feeds.
    duration_s : float
        Of an honest feed.
    """

    part: str = "test"
    first_seed: int = 0
    clips: int = 10 * ROUND
    duration_s: float = 900.0

    def __post_init__(self) -> None:
        if self.duration_s < 60:
            raise UsageError(f"feeds of {self.duration_s:g} s", "a minute at least")

    def feeds(self) -> list[DrawnFeed]:
        """Return the feeds in the order of the run."""
        turns = (HONEST,) * (HONEST_EACH - 1) + ATTACKS + (HONEST,)
        return [
            DrawnFeed(turns[n % ROUND], self.part, self.first_seed + n, self.duration_s)
            for n in range(self.clips)
        ]
