"""The grid, and the lamps that hang on it: light as a function of the grid's phase alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEP_S, SETTLE_S, BEFORE_S, AFTER_S = 0.1, 1500.0, 2.0, 4.0
PERIOD_SAMPLES, HARMONICS, QUICK_S = 512, 12, 2.0


@dataclass(frozen=True, eq=False)
class Grid:
    """The mains over time: its phase in turns, with continuous frequency and slope.

    Attributes
    ----------
    nominal_hz : float
    turns : CubicSpline
        Turns of the mains' phase at a time in seconds; defined from 2 s before the film.
    """

    nominal_hz: float
    turns: CubicSpline

    def hz(self, t_s: Array) -> Array:
        """Frequency of the mains, at times."""
        return np.asarray(self.turns(t_s, 1), dtype=float)


def draw_grid(
    rng: np.random.Generator, nominal_hz: float, duration_s: float, rough_hz: float = 0.0
) -> Grid:
    """Draw a course: an Ornstein-Uhlenbeck process of minutes, behind the inertia of machines.

    The spread is 15 to 25 mHz and the rate of change about 1 mHz in a second. A rougher grid has
    quick changes beside, behind an inertia of 2 s twice over, so that the second difference of its
    means over seconds is `rough_hz` rms. A measured day of continental Europe (17 September 2022)
    has 1.06 mHz, and that spectrum between 0.3 and 0.5 Hz.
    """
    count = int((SETTLE_S + BEFORE_S + duration_s + AFTER_S) / STEP_S) + 1
    spread_hz, slow_s = rng.uniform(0.015, 0.025), rng.uniform(120.0, 400.0)
    away_hz = rng.standard_normal(count) * spread_hz * np.sqrt(2 * STEP_S / slow_s)
    for time_s in (slow_s, *rng.uniform(1.0, 3.0, 2)):
        keep = np.exp(-STEP_S / time_s)
        gain = 1.0 if time_s == slow_s else 1.0 - keep
        away_hz = lfilter([gain], [1.0, -keep], away_hz)
    away_hz = away_hz[int(SETTLE_S / STEP_S) :]
    if rough_hz:
        keep = np.exp(-STEP_S / QUICK_S)
        quick_hz = rng.standard_normal(len(away_hz))
        for _ in range(2):
            quick_hz = lfilter([1.0 - keep], [1.0, -keep], quick_hz)
        away_hz = away_hz + _gain(away_hz, quick_hz, rough_hz) * quick_hz
    away_hz = away_hz + nominal_hz
    turns = np.concatenate([[0.0], np.cumsum((away_hz[1:] + away_hz[:-1]) / 2 * STEP_S)])
    t_s = np.arange(len(turns)) * STEP_S - BEFORE_S
    return Grid(nominal_hz, CubicSpline(t_s, turns + rng.uniform()))


def _gain(slow_hz: Array, quick_hz: Array, rough_hz: float) -> float:
    """How much of the quick makes the slow as rough as asked; none where it is already."""
    per_s = round(1 / STEP_S)

    def bends(course_hz: Array) -> Array:
        seconds = course_hz[: len(course_hz) // per_s * per_s].reshape(-1, per_s).mean(axis=1)
        return np.diff(seconds, 2)

    slow, quick = bends(slow_hz), bends(quick_hz)
    square, cross = float(quick @ quick), float(quick @ slow)
    lacks = rough_hz**2 * len(slow) - float(slow @ slow)
    return (np.sqrt(cross**2 + square * lacks) - cross) / square if lacks > 0 else 0.0


@dataclass(frozen=True, eq=False)
class Lamp:
    """Light about its mean of one: parts at multiples of the mains' frequency.

    Attributes
    ----------
    kind : str
    order : ndarray of int
        Multiples of the mains' frequency, rising; 2 is the first harmonic of the light.
    size : ndarray of complex
        ``light = 1 + real(sum(size * exp(2j * pi * order * turns)))``.
    """

    kind: str
    order: NDArray[np.int64]
    size: Complex

    @property
    def first(self) -> complex:
        """Of twice the mains' frequency."""
        return complex(self.size[self.order == 2][0])

    def exposed(self, mains_hz: float, exposure_s: float, *, beside_hz: float = 0.0) -> Lamp:
        """As a row sees it, at the middle of its exposure.

        `beside_hz` shifts every part by a tone that the light is multiplied by.
        """
        return replace(
            self, size=self.size * np.sinc((self.order * mains_hz + beside_hz) * exposure_s)
        )

    def shifted(self, light_rad: float) -> Lamp:
        """Turned by a phase of the first harmonic."""
        return replace(self, size=self.size * np.exp(0.5j * self.order * light_rad))

    def flicker(self, turn: Complex) -> Complex:
        """Complex sum of the parts where the mains' phase is ``turn = exp(2j*pi*turns)``."""
        total = np.zeros_like(turn)
        size = dict(zip(self.order.tolist(), self.size, strict=True))
        twice = turn * turn
        odd = [size.get(order, 0.0) for order in range(1, max(size) + 1, 2)]
        even = [size.get(order, 0.0) for order in range(2, max(size) + 1, 2)]
        for part in even[::-1]:  # Horner's scheme
            total = (total + part) * twice
        if any(odd):
            ripple = np.zeros_like(turn)
            for part in odd[::-1]:
                ripple = ripple * twice + part
            total += ripple * turn
        return total


def _of_harmonics(kind: str, size: Complex) -> Lamp:
    return Lamp(kind, 2 * np.arange(1, len(size) + 1), size)


def _of_wave(kind: str, wave: Array, depth: float, delay_s: tuple[float, float]) -> Lamp:
    """From one period of light, thinned to `depth`; a share of it glows after for a time."""
    share, glow_s = delay_s
    parts = 2 * np.fft.rfft(wave)[: HARMONICS + 1]
    parts /= parts[0].real / 2
    order = np.arange(HARMONICS + 1)
    parts *= 1 - share + share / (1 + 2j * np.pi * 100.0 * order * glow_s)
    return _of_harmonics(kind, parts[1:] * depth / abs(parts[1]))


def _led(rng: np.random.Generator) -> Lamp:
    ratio = [1.0, rng.uniform(0.05, 0.3), rng.uniform(0.02, 0.1), rng.uniform(0.01, 0.04)]
    while len(ratio) < HARMONICS:
        ratio.append(ratio[-1] * rng.uniform(0.4, 0.8))
    turn = np.exp(2j * np.pi * rng.uniform(size=HARMONICS))
    return _of_harmonics("led", _depth(rng, 0.03, 0.2) * np.array(ratio) * turn)


def _cfl(rng: np.random.Generator) -> Lamp:
    """A condenser charged at each crest feeds the tube; phosphor glows after."""
    crest = np.abs(np.sin(np.pi * np.arange(PERIOD_SAMPLES) / PERIOD_SAMPLES))
    drop, volt, held = rng.uniform(0.1, 0.4) / PERIOD_SAMPLES, 0.9, np.empty(2 * PERIOD_SAMPLES)
    for index in range(2 * PERIOD_SAMPLES):
        volt = max(volt - drop, crest[index % PERIOD_SAMPLES])
        held[index] = volt
    wave = held[PERIOD_SAMPLES:] ** rng.uniform(1.0, 2.5)
    glow = rng.uniform(0.3, 0.8), rng.uniform(1e-3, 3e-3)
    return _varied(_of_wave("cfl", wave, _depth(rng, 0.03, 0.1), glow), rng)


def _incandescent(rng: np.random.Generator) -> Lamp:
    """A filament stores heat; some hang on a dimmer that cuts the beginning of each half wave."""
    angle = np.pi * np.arange(PERIOD_SAMPLES) / PERIOD_SAMPLES
    cut_rad = rng.choice([0.0, rng.uniform(0.2, 1.6)])
    heat = 2 * np.fft.rfft(np.sin(angle) ** 2 * (angle >= cut_rad))
    order, slow_s = np.arange(len(heat)), rng.uniform(0.05, 0.4)
    heat /= 1 + 2j * np.pi * 100.0 * order * slow_s
    depth, steep = _depth(rng, 0.03, 0.15), rng.uniform(6.0, 11.0)
    heat[0] = 0.0
    warm = np.fft.irfft(heat, PERIOD_SAMPLES)
    warm *= depth / steep / (2 * abs(np.fft.rfft(warm)[1]) / PERIOD_SAMPLES)
    return _varied(_of_wave("incandescent", (1 + warm) ** steep, depth, (0.0, 0.0)), rng)


def _magnetic(rng: np.random.Generator) -> Lamp:
    """A tube on a choke: its arc dies at each zero of the current and strikes late."""
    crest = np.abs(np.sin(np.pi * np.arange(PERIOD_SAMPLES) / PERIOD_SAMPLES))
    wave = np.clip(crest - rng.uniform(0.02, 0.2), 0.0, None) ** rng.uniform(0.6, 1.2)
    glow = rng.uniform(0.3, 0.8), rng.uniform(5e-4, 4e-3)
    return _varied(_of_wave("magnetic", wave, _depth(rng, 0.06, 0.2), glow), rng)


def _half_wave(rng: np.random.Generator) -> Lamp:
    """An ageing tube or a broken rectifier: its half waves differ."""
    even = _led(rng) if rng.uniform() < 0.5 else _magnetic(rng)
    ratio = rng.uniform(0.05, 0.4) * np.cumprod([1.0, *rng.uniform(0.1, 0.5, 3)])
    odd = abs(even.first) * ratio * np.exp(2j * np.pi * rng.uniform(size=4))
    order = np.concatenate([even.order, [1, 3, 5, 7]])
    by_order = np.argsort(order)
    return Lamp("half_wave", order[by_order], np.concatenate([even.size, odd])[by_order])


def _tone(rng: np.random.Generator) -> Lamp:
    return _of_harmonics("tone", np.array([_depth(rng, 0.03, 0.2) + 0j]))


def _depth(rng: np.random.Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def _varied(lamp: Lamp, rng: np.random.Generator) -> Lamp:
    """No two specimens are alike: the harmonics after the first differ a little."""
    change = 0.25 * (rng.standard_normal(len(lamp.size)) + 1j * rng.standard_normal(len(lamp.size)))
    change[lamp.order == 2] = 0.0
    return replace(lamp, size=lamp.size * np.exp(change))


LAMPS: dict[str, Callable[[np.random.Generator], Lamp]] = {
    "led": _led,
    "cfl": _cfl,
    "incandescent": _incandescent,
    "magnetic": _magnetic,
    "half_wave": _half_wave,
    "tone": _tone,
}
COMMON = {"led": 0.5, "cfl": 0.14, "incandescent": 0.16, "magnetic": 0.16, "half_wave": 0.04}


def draw_lamp(rng: np.random.Generator, kind: str = "") -> Lamp:
    """Draw a lamp, of a kind or of any: most are LED, few are half-wave, none a pure tone."""
    drawn = str(rng.choice(list(COMMON), p=list(COMMON.values())))
    lamp = LAMPS[kind or drawn](rng)
    return lamp.shifted(rng.uniform(0.0, 2 * np.pi))
