"""Blind discovery: effects hidden in simulated recordings, and what the workflow says of each.

Here: which cases there are (one effect, two, none, or one that isn't in the catalogue), and the
effects outside the catalogue, applied to row means. From a case to a table::

    trial          a case drawn from its seed, simulated, and compared with its truth
    beside         cases of a clock error, with a reference of the grid
    judge          outcome of an answer, and errors of its parameters
    foreign        the same on a camera that shares no code with rsenf's own model
    table          records to rates, and the confusion matrix; of that camera, against the marks
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import combinations
from typing import Any, TypeVar

import numpy as np

from rsenf.bench.harness import Made, Run
from rsenf.errors import UsageError
from rsenf.model import CATALOGUE
from rsenf.model.noise import Float32Array, generator

C = TypeVar("C")
Do = Callable[[Float32Array, np.ndarray, np.random.Generator], Float32Array]


def shaken(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """A periodic shift by a fraction of a row, with a gain."""
    swing = np.sin(2 * np.pi * rng.uniform(2.0, 11.0) * t_s + rng.uniform(0, 6))
    moved = level + 0.2 * swing * (np.roll(level, 1, axis=1) - level)
    return np.asarray(moved * (1 + 0.001 * swing))


def brightened(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """A step of the gain."""
    since = t_s > rng.uniform(0.3, 0.7) * t_s.max()
    return np.asarray(level * np.where(since, 1.01, 1.0))


def shaded(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """A pulsating shadow on the lower third."""
    lower = np.arange(level.shape[1])[:, None] > 2 * level.shape[1] // 3
    pulse = 0.005 * (1 + np.cos(2 * np.pi * rng.uniform(0.5, 4.0) * t_s)) ** 2
    return np.asarray(level * (1 - pulse * lower))


def clipped(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """Compression above a level."""
    knee = np.quantile(level, rng.uniform(0.6, 0.8))
    return np.asarray(np.where(level > knee, knee + 0.3 * (level - knee), level))


def sawn(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """A sawtooth gain."""
    saw = (rng.uniform(0.3, 1.5) * t_s) % 1.0
    return np.asarray(level * (1 + 0.006 * (saw - 0.5)))


def beaten(level: Float32Array, t_s: np.ndarray, rng: np.random.Generator) -> Float32Array:
    """Every few seconds a frame blended with the one before."""
    every = int(rng.integers(40, 90))
    out = level.copy()
    out[every::every] = 0.6 * level[every::every] + 0.4 * level[every - 1 : -1 : every]
    return out


EFFECTS: tuple[Do, ...] = (shaken, brightened, shaded, clipped, sawn, beaten)
OUTSIDE = {effect.__name__: effect for effect in EFFECTS}
# Equal to an effect of the catalogue: any variable gain.
LIKE = {"brightened": "auto_exposure", "sawn": "auto_exposure"}


def done_to(
    name: str, level: Float32Array, rate: Fraction, rng: np.random.Generator
) -> Float32Array:
    """Apply an effect outside the catalogue to row means.

    Parameters
    ----------
    name : str
        Of :data:`OUTSIDE`.
    level : ndarray, shape (frames, lines, strips)
    rate : Fraction
        Frames a second.
    rng : numpy.random.Generator
    """
    t_s = np.arange(level.shape[0])[:, None, None] / float(rate)
    return OUTSIDE[name](level, t_s, rng).astype(np.float32)


KINDS = ("one", "none", "outside", "pair")
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
class Case:
    """A simulated recording, and the effects hidden in it.

    Attributes
    ----------
    kind : str
        One of :data:`KINDS`.
    hidden : tuple of str
        Names of effects, of the catalogue or of :data:`OUTSIDE`.
    seed : int
    times : float
        Strength, over the weakest that is to be named.
    duration_s : float
    video : bool
        Encoded and decoded; else the row means of the sensor.
    """

    kind: str
    hidden: tuple[str, ...]
    seed: int
    times: float
    duration_s: float
    video: bool

    @property
    def key(self) -> str:
        """Unique name, by which its record is found."""
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
        """Return all cases in random order, each with a seed of its own."""
        hidden: list[tuple[str, tuple[str, ...]]] = [
            ("one", (name,)) for name in self.effects for _ in range(self.each)
        ]
        hidden += [("none", ()) for _ in range(self.none)]
        outside = list(OUTSIDE)
        hidden += [("outside", (outside[n % len(outside)],)) for n in range(self.outside)]
        rng = generator(self.first_seed, "pairs")
        pairs = groups_of(self.effects, 2, self.pairs, rng, _go_together)
        hidden += [("pair", names) for names in pairs]
        return mixed(
            [
                Case(kind, names, self.first_seed + n, self.times, self.duration_s, self.video)
                for n, (kind, names) in enumerate(hidden)
            ],
            self.first_seed,
        )


def groups_of(
    effects: Sequence[str],
    size: int,
    count: int,
    rng: np.random.Generator,
    go_together: Callable[[str, str], bool],
) -> list[tuple[str, ...]]:
    """Draw groups of effects that can be hidden at once, none twice if there are enough.

    Parameters
    ----------
    effects : sequence of str
    size : int
        Effects of a group.
    count : int
        Number of groups; none are returned if no effects go together.
    rng : numpy.random.Generator
    go_together : callable
        Whether two effects can be hidden at once.
    """
    groups = [
        some
        for some in combinations(effects, size)
        if all(go_together(*two) for two in combinations(some, 2))
    ]
    count = count if groups else 0
    drawn = rng.choice(max(len(groups), 1), count, replace=count > len(groups))
    return [groups[n] for n in drawn.tolist()]


def mixed(cases: Sequence[C], seed: int) -> list[C]:
    """Return cases in random order: a run that is stopped halfway has some of every kind."""
    return [cases[n] for n in generator(seed, "order").permutation(len(cases)).tolist()]


def _go_together(one: str, other: str) -> bool:
    return not (other in CATALOGUE[one].never_with or one in CATALOGUE[other].never_with)


QUICK: dict[str, Any] = {
    "each": 1, "none": 1, "outside": 1, "pairs": 0, "duration_s": 27.0,
    "effects": ("harmonics", "frame_drop", "timestamp_jitter"),
}  # fmt: skip


def measure(run: Run) -> Made:
    """Run the workflow on the cases that are missing, of rsenf's own model or a foreign camera.

    Raises
    ------
    UsageError
        For effects that can't be hidden, or options of the other camera.
    """
    from rsenf.bench.discover.beside import SKEW, clock_cases, tried
    from rsenf.bench.discover.table import draw, tabulated, text

    options = run.options
    if options.foreign:
        return _measure_foreign(run)
    for option in ("triples", "rows"):
        if getattr(options, option) is not None:
            raise UsageError(f"--{option} without --foreign", "only a foreign camera has it")
    hidden = _hidden(run, (*listed(), SKEW), left_out())
    if hidden:
        options.hide = [name for name in hidden if name != SKEW]
    each = 20 if options.clips is None else options.clips
    many = 0 if hidden or options.video else each
    usual: dict[str, Any] = {"duration_s": 30.0} if options.video else {}
    usual |= {"none": 5 * many, "outside": 2 * many, "pairs": 2 * many}
    plan = run.settings(Plan, **(QUICK if options.quick else usual))
    cases = plan.cases()
    if not (options.quick or options.video or (hidden and SKEW not in hidden)):
        # Cases with a reference use the seeds that follow the others'.
        cases += clock_cases(plan.each, plan.first_seed + len(cases), plan.duration_s)
    work = partial(tried, grids=options.grids)
    return Made(tabulated(run.records(cases, work, "discover.jsonl", "cases")), text, draw)


def _measure_foreign(run: Run) -> Made:
    from rsenf.bench.discover import foreign, table

    options, path = run.options, run.options.foreign.absolute()
    camera = foreign.camera_at(path)
    can = (*foreign.listed(camera), *camera.UNKNOWN, *foreign.physical(camera))
    hidden = _hidden(run, can, foreign.left_out(camera))
    many = 0 if hidden else 20 if options.clips is None else options.clips
    usual = {"none": 5 * many, "outside": 3 * many, "pairs": 3 * many, "triples": many}
    quick = QUICK | {"triples": 0, "rows": 240}
    cases = run.settings(foreign.Plan, **(quick if options.quick else usual)).cases_of(camera)
    records = run.records(cases, partial(foreign.tried, path=path), "foreign.jsonl", "cases")
    return Made(table.foreign_tabulated(records), table.foreign_text, table.draw)


def _hidden(run: Run, can: Sequence[str], never: dict[str, str]) -> Sequence[str]:
    """Return the effects of --hide; without it, note which ones aren't hidden, and why."""
    hidden: Sequence[str] = run.options.hide or ()
    if unknown := set(hidden) - set(can):
        why = never.get(min(unknown), "it is no effect")
        raise UsageError(f"--hide {min(unknown)}: {why}", f"one of {', '.join(can)}")
    if not (hidden or run.options.quick):
        for name, why in never.items():
            run.note(f"not hidden among the others: {name}: {why}")
    return hidden
