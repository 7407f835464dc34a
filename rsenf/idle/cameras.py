"""Which of the known cameras? The likelihood ratio of each, by its read-out time in one mode.

A camera's read-out time in a mode is the mean over its recordings, whose scatter beyond their
stated errors (a codec's, a stabiliser's) is estimated from them (DerSimonian & Laird, Controlled
Clinical Trials 7, 177, 1986) and shrunk to what is usual, since few recordings tell little of it.

*This camera*: the recording's time is the camera's. *Another of those about*: it is of the same
model, and so has the same time, or drawn from the prior of :mod:`rsenf.idle.compare`. The ten
best-selling phones of 2021 and 2022 made up 19 % of the sales of some 4000 models (Counterpoint
Research, March 2023): two owners have the same one in half a percent of cases; twice that is
assumed, since models share sensors. So no ratio says more than 100.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsenf.idle.compare import COMPATIBLE, DIFFERENT, MOST_LOG10_LR, is_same_rate, log10_ratio
from rsenf.messages.schema import FloatArray

SAME_MODEL_RATIO = 0.01
# Of estimates that are of something else: a codec that copies rows, a crop that nobody told of.
ASTRAY_RATIO = 0.005
# Scatter between a camera's recordings over its read-out time, worth so many recordings' telling: a
# guess. Published values of one model (iPhone 3GS, 5) are 0.2 to 0.3 % apart, errors included.
USUAL_SCATTER_RATIO, USUAL_FREEDOM = 1e-3, 4.0
WEAK_LOG10_LR = 1.0


@dataclass(frozen=True, kw_only=True)
class Mode:
    """What a read-out time belongs to. ``across_px`` is 0 and ``crop`` empty where not known."""

    frame_rate_hz: float
    lines: int
    across_px: int = 0
    crop: str = ""

    def may_be(self, other: Mode) -> bool:
        """Whether a recording of the other mode may be of this one, for all that is known."""
        pairs = ((self.across_px, other.across_px), (self.crop, other.crop))
        return (
            is_same_rate(self.frame_rate_hz, other.frame_rate_hz)
            and self.lines == other.lines
            and all(a == b or not (a and b) for a, b in pairs)
        )


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A recording's read-out time, and its camera's clock error where that is known.

    ``sha256`` is of its file, empty without one.
    """

    recording: str
    sha256: str = ""
    mode: Mode
    direction: str
    read_out_time_s: float
    read_out_time_std_s: float
    clock_ppm: float | None = None


@dataclass(frozen=True)
class Known:
    """A camera in one of its modes."""

    name: str
    mode: Mode
    readings: tuple[Reading, ...]

    @property
    def scatter_s(self) -> float:
        """Standard deviation between recordings, beyond their stated errors."""
        time_s, var = _times(self.readings)
        weight, more = 1.0 / var, time_s.size - 1
        mean_s = float(np.average(time_s, weights=weight))
        usual_var = (USUAL_SCATTER_RATIO * mean_s) ** 2
        found_var = 0.0
        if more:
            room = weight.sum() - (weight**2).sum() / weight.sum()
            found_var = max((float(weight @ (time_s - mean_s) ** 2) - more) / room, 0.0)
        return math.sqrt((USUAL_FREEDOM * usual_var + more * found_var) / (USUAL_FREEDOM + more))

    @property
    def read_out(self) -> tuple[float, float]:
        """Read-out time and its standard error (s)."""
        time_s, var = _times(self.readings)
        weight = 1.0 / (var + self.scatter_s**2)
        return float(np.average(time_s, weights=weight)), float(weight.sum() ** -0.5)

    @property
    def directions(self) -> set[str]:
        """In which it was read, as far as told apart."""
        return {r.direction for r in self.readings} - {""}


def _times(readings: Sequence[Reading]) -> tuple[FloatArray, FloatArray]:
    """Read-out times and the variances stated of them."""
    told = np.array([(r.read_out_time_s, r.read_out_time_std_s) for r in readings])
    return told[:, 0], told[:, 1] ** 2


def known_modes(name: str, readings: Sequence[Reading]) -> list[Known]:
    """Sort a camera's recordings by their modes, in the order in which they came."""
    modes: dict[Mode, list[Reading]] = {}
    for reading in readings:
        own = reading.mode
        alike = (
            m for m in modes if m.may_be(own) and replace(m, frame_rate_hz=own.frame_rate_hz) == own
        )
        modes.setdefault(next(alike, own), []).append(reading)
    return [Known(name, mode, tuple(of_mode)) for mode, of_mode in modes.items()]


def log10_lr(known: Known, reading: Reading, same_model_ratio: float = SAME_MODEL_RATIO) -> float:
    """Weigh "this camera took it" against "another of those about did".

    Parameters
    ----------
    known : Known
    reading : Reading
        Of the recording in question, in a mode that may be the camera's.
    same_model_ratio : float
        Share of the cameras about that are of the same model.
    """
    (time_s, std_s), own_s = known.read_out, reading.read_out_time_std_s
    times = np.array([time_s, reading.read_out_time_s])
    stds = np.array([std_s, math.hypot(own_s, known.scatter_s)])
    ratio = 10.0 ** min(log10_ratio(times, stds, 1.0 / known.mode.frame_rate_hz), MOST_LOG10_LR)
    same = ASTRAY_RATIO + (1.0 - ASTRAY_RATIO) * ratio
    return math.log10(same / (same_model_ratio * same + (1.0 - same_model_ratio)))


def log10_odds(log10_lrs: Sequence[float]) -> float:
    """Return the odds that the best of these took it, and none of the others nor an unknown one.

    The camera of the case is as likely to be known as not, and each known one as likely as another.
    """
    ratios = 10.0 ** np.array(log10_lrs)
    best = float(ratios.max())
    return math.log10(best / (ratios.size + float(ratios.sum()) - best))


def verdict_of(log10_lr: float) -> str:
    """Return 'different', 'compatible' or 'undecidable', as of two recordings."""
    if log10_lr <= DIFFERENT:
        return "different"
    return "compatible" if log10_lr >= COMPATIBLE else "undecidable"
