"""Cases: what is drawn from a seed, and the film of it."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import take
from .effects import EFFECTS, HARD, NEUTRAL, PHYSICAL, UNKNOWN, Effect, go_together
from .filters import FILTERS
from .light import LAMPS, Array, draw_grid, draw_lamp
from .plan import Plan, Sensor, Shining
from .rest import leave_rest
from .scene import draw_wall

START_S = 0.5
# Nominal mains and frame rates at which the flicker moves well, and those at which it creeps.
MOVING = (
    (50.0, "24000/1001"),
    (50.0, "30000/1001"),
    (50.0, "30"),
    (50.0, "60000/1001"),
    (60.0, "25"),
)
CREEPING = ((60.0, "24000/1001"), (60.0, "30000/1001"), (60.0, "60000/1001"))
CREEPING_SHARE = 0.04


@dataclass(frozen=True, kw_only=True)
class Case:
    """What to film.

    Attributes
    ----------
    hidden : tuple of str
        Names in `EFFECTS`, `UNKNOWN`, `PHYSICAL` or `HARD`.
    seed : int
        The same seed is the same lamp, grid, scene, camera and noise, whatever is hidden.
    times : float
        Strength, over the smallest that is listed.
    duration_s : float
    rows, strips : int
    lamp : str
        Kind of lamp; empty draws one, never ``"tone"`` (no harmonics at all).
    rate : str
        Frame rate such as ``"30000/1001"``; empty draws one at which the flicker moves.
    nominal_hz : float
        Of the mains; 0 draws 50 or 60.
    rest : float
        Strength of a small rest that has no name: at 1, each part of it is about 1e-4.
    rough_hz : float
        Second difference of the grid's means over seconds, rms; 0 leaves it as it is drawn.
    filtered : str
        Name in `FILTERS` of what its file goes through; rows are what they were before.
    """

    hidden: tuple[str, ...] = ()
    seed: int = 0
    times: float = 3.0
    duration_s: float = 60.0
    rows: int = 720
    strips: int = 2
    lamp: str = ""
    rate: str = ""
    nominal_hz: float = 0.0
    rest: float = 0.0
    rough_hz: float = 0.0
    filtered: str = ""

    def __post_init__(self) -> None:
        if unknown := set(self.hidden) - set(HIDEABLE):
            raise ValueError(f"nothing of that name can be hidden: {', '.join(sorted(unknown))}")
        if self.lamp and self.lamp not in LAMPS:
            raise ValueError(f"no lamp of kind {self.lamp!r}; there are {', '.join(LAMPS)}")
        if self.filtered and self.filtered not in FILTERS:
            raise ValueError(f"no filter {self.filtered!r}; there are {', '.join(FILTERS)}")


@dataclass(frozen=True, eq=False)
class Filmed:
    """A film, and the truth about it.

    Attributes
    ----------
    level : ndarray of float32 (frames, rows, strips)
        Mean 8-bit level of each row in each strip.
    stamp_s : ndarray (frames,)
    truth : dict
        Plain values, units in their names. What is about light and rows is as rows show it, after
        exposure: ``flicker_ratio`` of the first harmonic, ``harmonics`` (its multiples from the
        first on) and ``half_wave`` (odd halves of it) relative to that; all of the first lamp.
        ``grid_hz`` are means over the seconds from ``grid_s`` on, which count from the first frame
        on the file's clock. ``mains``: whether light of the mains falls on the scene at all.
        ``idle_ratios``: that of the sensor's frames first, then what may fairly be said instead,
        of the file's frames or of a field.
    hidden : dict of dict
        Parameters of each effect hidden, as rows show them.
    mean_hz : callable
        Mean frequency of the grid from times to others, on the file's clock.
    """

    level: NDArray[np.float32]
    stamp_s: Array
    truth: dict[str, Any]
    hidden: dict[str, dict[str, Any]]
    mean_hz: Callable[[Array, Array], Array]


HIDEABLE: dict[str, Effect] = {**EFFECTS, **UNKNOWN, **PHYSICAL, **HARD}


def film(case: Case) -> Filmed:
    """Film a case."""
    return shoot(case, noisy=True)


def shoot(case: Case, *, noisy: bool) -> Filmed:
    """Film a case, or what it would be without any noise or rounding."""
    plan, hidden = plan_of(case)
    level = take(plan, drawn_for(case, "noise"), noisy=noisy)
    return Filmed(level, plan.stamp_s, _truth(case, plan), hidden, plan.mean_hz)


def drawn_for(case: Case, purpose: str) -> np.random.Generator:
    """Random numbers for a purpose, which don't depend on what else is drawn."""
    return np.random.default_rng([case.seed, zlib.crc32(purpose.encode())])


def plan_of(case: Case) -> tuple[Plan, dict[str, dict[str, Any]]]:
    """Draw a plan with all that a case hides, and that with its parameters."""
    nominal_hz, rate = _pace(case)
    sensor = _sensor(case, float(rate), drawn_for(case, "camera"))
    start_s = START_S + np.arange(round(case.duration_s * float(rate))) / float(rate)
    plan = Plan(
        grid=draw_grid(
            drawn_for(case, "grid"), nominal_hz, START_S + case.duration_s, case.rough_hz
        ),
        sensor=sensor,
        lamps=[Shining(lamp=draw_lamp(drawn_for(case, "lamp"), case.lamp), share=np.ones(1))],
        wall=draw_wall(drawn_for(case, "scene"), case.rows, case.strips),
        begin_s=START_S,
        start_s=start_s,
        stamp_s=start_s - START_S,
        readout_s=np.full(len(start_s), sensor.readout_s),
        line=np.arange(case.rows) / case.rows,
        late_s=np.zeros(case.rows),
        arrive=np.arange(len(start_s)),
    )
    hidden = {}
    for name in sorted(case.hidden, key=list(HIDEABLE).index):
        effect = HIDEABLE[name]
        hidden[name] = effect.hide(plan, effect.size(case.times), drawn_for(case, name))
    if case.filtered:
        done = FILTERS[case.filtered]
        plan.file_rate = done.rate(plan.file_rate or sensor.frame_rate)
        plan.speed = done.speed
    if case.rest:
        leave_rest(plan, case.rest, drawn_for(case, "rest"))
    return plan, hidden


def draw_case(seed: int) -> Case:
    """Draw what to film: nothing hidden, one effect, two of them, or something in no catalogue."""
    rng = np.random.default_rng([seed, zlib.crc32(b"case")])
    strips = int(rng.choice([1, 2, 2, 2, 3, 4]))
    kind = str(
        rng.choice(["nothing", "neutral", "one", "two", "odd"], p=[0.2, 0.1, 0.4, 0.15, 0.15])
    )
    named = [
        name
        for name, effect in EFFECTS.items()
        if name not in NEUTRAL and effect.needs != "reference"
        if strips > 1 or effect.needs != "strips"
    ]
    hidden: tuple[str, ...] = ()
    if kind == "neutral":
        hidden = (str(rng.choice(NEUTRAL)),)
    elif kind == "odd":
        hidden = (str(rng.choice(list(UNKNOWN))),)
    elif kind != "nothing":
        one, other = rng.choice(named, 2, replace=False).tolist()
        while kind == "two" and not go_together(one, other):
            one, other = rng.choice(named, 2, replace=False).tolist()
        hidden = (one,) if kind == "one" else (one, other)
    rows = int(rng.choice([240, 480, 720, 720, 1080]))
    return Case(hidden=hidden, seed=seed, rows=rows, strips=strips)


def _pace(case: Case) -> tuple[float, Fraction]:
    """Draw the mains and the frame rate together, or what of them the case leaves open."""
    rng = drawn_for(case, "pace")
    creeps = rng.uniform() < CREEPING_SHARE
    order = rng.uniform(size=len(MOVING) + len(CREEPING))
    pairs = (*MOVING, *CREEPING) if not creeps else (*CREEPING, *MOVING)
    edge = len(CREEPING) if creeps else len(MOVING)
    order[edge:] += 1.0  # the others only where nothing else is left
    for index in np.argsort(order):
        nominal_hz, rate = pairs[index]
        if case.nominal_hz in (0.0, nominal_hz) and case.rate in ("", rate):
            return nominal_hz, Fraction(rate)
    return case.nominal_hz or 50.0, Fraction(case.rate or "30000/1001")


def _sensor(case: Case, rate: float, rng: np.random.Generator) -> Sensor:
    wide = case.rows * 16 / 9 * rng.uniform(0.5, 1.0)
    return Sensor(
        frame_rate=rate,
        idle_ratio=float(rng.uniform(0.1, 0.6)),
        exposure_s=float(np.exp(rng.uniform(np.log(1e-4), np.log(6e-3)))),
        pixels=int(wide / case.strips),
        well_electrons=float(np.exp(rng.uniform(np.log(5e3), np.log(15e3)))),
        read_electrons=float(rng.uniform(1.5, 6.0)),
        row_noise_level=float(rng.uniform(0.003, 0.02)),
    )


def _truth(case: Case, plan: Plan) -> dict[str, Any]:
    sensor = plan.sensor
    at_s = np.arange(0.0, np.ceil(plan.stamp_s[-1]))
    readout_s = float(abs(plan.line[-1] - plan.line[0]) * case.rows / (case.rows - 1))
    readout_s *= float(plan.readout_s.mean())
    file_rate = plan.file_rate or sensor.frame_rate
    fields = 2 if "interlace" in case.hidden else 1
    rates = sensor.frame_rate, file_rate / plan.speed, fields * file_rate / plan.speed
    return {
        "frame_rate": sensor.frame_rate,
        "file_rate": file_rate,
        "nominal_hz": plan.grid.nominal_hz,
        "mains": bool(plan.lamps),
        "idle_ratio": 1.0 - readout_s * sensor.frame_rate,
        "idle_ratios": [1.0 - readout_s * rate for rate in dict.fromkeys(rates)],
        "readout_s": readout_s,  # of the sensor
        "direction": "forward" if plan.line[-1] > plan.line[0] else "reverse",
        "exposure_s": sensor.exposure_s,
        **_light(plan),
        "f0_mean_hz": 2 * plan.mains_hz,
        "alias_hz": plan.alias_hz(2 * plan.mains_hz),
        "grid_s": at_s.tolist(),
        "grid_hz": plan.mean_hz(at_s, at_s + 1.0).tolist(),
        "pixels": sensor.pixels,
        "well_electrons": sensor.well_electrons,
        "read_electrons": sensor.read_electrons,
        "row_noise_level": sensor.row_noise_level,
        "rest": case.rest,
    }


def _light(plan: Plan) -> dict[str, Any]:
    if not plan.lamps:
        return {"lamp": "none", "flicker_ratio": 0.0, "harmonics": [], "half_wave": []}
    seen = plan.seen
    parts = dict(zip(seen.order.tolist(), np.abs(seen.size / seen.first).tolist(), strict=True))
    return {
        "lamp": seen.kind,
        "flicker_ratio": abs(seen.first),
        "harmonics": [size for order, size in parts.items() if order % 2 == 0],
        "half_wave": [size for order, size in parts.items() if order % 2 == 1],
    }
