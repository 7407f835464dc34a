"""Likelihood ratio for each known camera, from its read-out time in one mode.

A camera's read-out time in a mode is the mean over its recordings. Their scatter beyond the stated
errors (a codec's, a stabiliser's) is estimated from them (DerSimonian, R. and Laird, N. (1986),
Controlled Clinical Trials 7, 177) and shrunk to a usual value, since few recordings determine it
poorly.

*This camera*: the recording's time is the camera's. *Another camera of the relevant population*:
its time is the same if it is of the same model, else drawn from the prior of
:mod:`rsenf.idle.compare`. The ten best-selling phones of 2021 and 2022 made up 19 % of the sales of
some 4000 models (Counterpoint Research, March 2023): two owners have the same one in half a percent
of cases; twice that is assumed, since models share sensors. So no ratio exceeds 100.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsenf.idle.compare import COMPATIBLE, DIFFERENT, MOST_LOG10_LR, is_same_rate, log10_ratio
from rsenf.messages.schema import FloatArray

SAME_MODEL_RATIO = 0.01
# Share of outliers: a codec that copies rows, an undeclared crop.
ASTRAY_RATIO = 0.005
# Usual scatter between a camera's recordings over its read-out time, and its weight in recordings:
# a guess. Published values of one model (iPhone 3GS, 5) are 0.2 to 0.3 % apart, errors included.
USUAL_SCATTER_RATIO, USUAL_FREEDOM = 1e-3, 4.0
WEAK_LOG10_LR = 1.0


@dataclass(frozen=True, kw_only=True)
class Mode:
    """Recording mode of a read-out time. ``across_px`` is 0 and ``crop`` empty if unknown."""

    frame_rate_hz: float
    lines: int
    across_px: int = 0
    crop: str = ""

    def may_be(self, other: Mode) -> bool:
        """Whether a recording of the other mode may be of this one, as far as is known."""
        pairs = ((self.across_px, other.across_px), (self.crop, other.crop))
        return (
            is_same_rate(self.frame_rate_hz, other.frame_rate_hz)
            and self.lines == other.lines
            and all(a == b or not (a and b) for a, b in pairs)
        )


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Read-out time of a recording, and its camera's clock error if known.

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
        """Read-out directions, as far as known."""
        return {r.direction for r in self.readings} - {""}


def _times(readings: Sequence[Reading]) -> tuple[FloatArray, FloatArray]:
    """Read-out times and their stated variances."""
    stated = np.array([(r.read_out_time_s, r.read_out_time_std_s) for r in readings])
    return stated[:, 0], stated[:, 1] ** 2


def known_modes(name: str, readings: Sequence[Reading]) -> list[Known]:
    """Group a camera's recordings by mode, in the order in which they came.

    Parameters
    ----------
    name : str
    readings : sequence of Reading
    """
    modes: dict[Mode, list[Reading]] = {}
    for reading in readings:
        key = reading.mode
        alike = (
            m for m in modes if m.may_be(key) and replace(m, frame_rate_hz=key.frame_rate_hz) == key
        )
        modes.setdefault(next(alike, key), []).append(reading)
    return [Known(name, mode, tuple(of_mode)) for mode, of_mode in modes.items()]


def log10_lr(known: Known, reading: Reading, same_model_ratio: float = SAME_MODEL_RATIO) -> float:
    """Log10 likelihood ratio of "this camera" against "another of the relevant population".

    Parameters
    ----------
    known : Known
    reading : Reading
        Of the recording in question, in a mode that may be the camera's.
    same_model_ratio : float
        Share of the relevant population that is of the same model.
    """
    (time_s, std_s), error_s = known.read_out, reading.read_out_time_std_s
    times = np.array([time_s, reading.read_out_time_s])
    stds = np.array([std_s, math.hypot(error_s, known.scatter_s)])
    ratio = 10.0 ** min(log10_ratio(times, stds, 1.0 / known.mode.frame_rate_hz), MOST_LOG10_LR)
    same = ASTRAY_RATIO + (1.0 - ASTRAY_RATIO) * ratio
    return math.log10(same / (same_model_ratio * same + (1.0 - same_model_ratio)))


def log10_odds(log10_lrs: Sequence[float]) -> float:
    """Posterior odds of the best camera against all others and an unknown one.

    A priori the camera is as likely known as not, and all known ones are equally likely.

    Examples
    --------
    >>> round(log10_odds([2.0, 0.0]), 2)
    1.52
    """
    ratios = 10.0 ** np.array(log10_lrs)
    best = float(ratios.max())
    return math.log10(best / (ratios.size + float(ratios.sum()) - best))


def verdict_of(log10_lr: float) -> str:
    """Return 'different', 'compatible' or 'undecidable', as for two recordings."""
    if log10_lr <= DIFFERENT:
        return "different"
    return "compatible" if log10_lr >= COMPATIBLE else "undecidable"
