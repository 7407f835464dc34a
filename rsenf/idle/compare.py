"""Likelihood ratios from read-out times: of two recordings, and of a recording and known cameras.

Model: the read-out time ``τ`` belongs to a sensor in a mode. *The same read-out*: both estimates
are of one time. *Different cameras*: each is of a time drawn from the prior ``p``. Half of it is
uniform over the frame, as the paper's cameras (idle 4 to 73 %). A quarter is uniform over the
frame's last quarter, where 17 of 22 measured modes of phones and action cameras are, mostly older
ones (Ringaby 2012; Oth et al., CVPR 2013; Thalin, Deshaker 2.5, 2010; all in the table of J. Huai's
fork of Kalibr). The last quarter is log-uniform, from the shortest that differs from a global
shutter, for fast stacked sensors.

A known camera's read-out time in a mode (:class:`Known`) is the mean over its recordings. Their
scatter beyond the stated errors (a codec's, a stabiliser's) is estimated from them (DerSimonian
1986) and shrunk to a usual value. *Another camera of the relevant population*: its time is the same
if it is of the same model, else drawn from the prior. The ten best-selling phones of 2021 and 2022
made up 19 % of the sales of some 4000 models (Counterpoint Research, March 2023): two owners have
the same one in half a percent of cases; twice that is assumed, since models share sensors. So no
ratio exceeds 100.

Statistic: ``LR = ∫ p·t_a·t_b dτ / (∫ p·t_a dτ · ∫ p·t_b dτ)``, with Student's t densities of the
two estimates: errors are systematic, and their sizes are estimated from a dozen bands of rows.

Approximate: the prior is no survey of cameras, but within a factor of about two of published
values. Of two recordings no ratio exceeds 10^±4. If two times agree, it may be the same camera,
another of its model, or chance: the paper's caveat.

References
----------
- DerSimonian, R. and Laird, N. (1986), Meta-analysis in clinical trials, Controlled Clinical
  Trials 7, 177.
- Ringaby, E. and Forssén, P.-E. (2012), Efficient video rectification and stabilisation for
  cell-phones, International Journal of Computer Vision 96, 335.
- ENFSI (2015), Guideline for evaluative reporting in forensic science.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rsenf.idle.refusals import SLACK_RATIO
from rsenf.medians import between_var
from rsenf.messages import IdleEstimate
from rsenf.messages.schema import FloatArray

SHORTEST_S = 4e-4
CROWDED_RATIO = 0.75  # of the frame, above which older phones cluster
PRIOR = (
    "read-out times of other cameras are half even over the frame, a quarter even over its last "
    "quarter, a quarter log-uniform, after published ones of 22 modes and five cameras; no survey"
)
FREEDOM = 10.0  # of Student's t
STEPS = 4001  # of the integral over the shared time
REACH = 40.0  # standard errors that it spans
# Limit of the log10 likelihood ratio: beyond it depends on the model of the errors alone.
MOST_LOG10_LR = 4.0
# Likelihood ratios of 100 against, and of 3 for.
DIFFERENT, COMPATIBLE = -2.0, 0.5
SMALLEST = 1e-12  # of a time or a frame rate in the store, and the inverse of the largest
SAME_RATE = 1.01e-3  # largest relative difference of equal frame rates: 30 and 29.97, as written

EQUAL_PROVES_NOTHING = (
    "equal read-out times don't prove one camera: others of its model have the same, and a few "
    "models share any value"
)
MODE = (
    "read-out depends on the mode: compare recordings of the same frame rate, resolution and crop"
)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Result of comparing two idle estimates.

    Parameters
    ----------
    verdict : str
        'different', 'compatible' or 'undecidable'.
    log10_lr_same_readout : float
        Log10 likelihood ratio of "the same read-out time" against "two cameras"; NaN if there is
        none.
    caveats : tuple of str
        What it doesn't prove.
    """

    verdict: str
    log10_lr_same_readout: float
    caveats: tuple[str, ...]


def compare_readout(a: IdleEstimate, b: IdleEstimate) -> Comparison:
    """Compare the read-out times of two recordings (ENFSI 2015).

    Parameters
    ----------
    a, b : IdleEstimate
        The last estimate of each.
    """
    caveats = list(_caveats(a, b))
    blank = [e for e in (a, b) if e.verdict != "estimated"]
    if blank:
        caveats += [f"no read-out time: {e.reason or e.verdict}" for e in blank]
        return Comparison(
            verdict="undecidable", log10_lr_same_readout=math.nan, caveats=tuple(caveats)
        )
    ratio = log10_ratio(
        np.array([a.read_out_time_s, b.read_out_time_s]),
        np.array([a.read_out_time_std_s, b.read_out_time_std_s]),
        1.0 / min(a.frame_rate_hz, b.frame_rate_hz),
    )
    log10_lr = float(np.clip(ratio, -MOST_LOG10_LR, MOST_LOG10_LR))
    verdict = "undecidable"
    if log10_lr <= DIFFERENT:
        verdict = "different"
    elif log10_lr >= COMPATIBLE:
        verdict = "compatible"
        caveats.insert(0, EQUAL_PROVES_NOTHING)
    return Comparison(verdict=verdict, log10_lr_same_readout=log10_lr, caveats=tuple(caveats))


def _caveats(a: IdleEstimate, b: IdleEstimate) -> list[str]:
    out = [MODE]
    if not is_same_rate(a.frame_rate_hz, b.frame_rate_hz):
        out.append(
            f"the frame rates differ ({a.frame_rate_hz:.3f} and {b.frame_rate_hz:.3f} Hz): one "
            "camera may have two read-out times"
        )
    if a.direction and b.direction and a.direction != b.direction:
        out.append("one was read from the top, the other from the bottom: a camera turned over?")
    return out


def is_same_rate(a_hz: float, b_hz: float) -> bool:
    """Whether two frame rates may be of one mode, such as 30 and 29.97 frames/s.

    Examples
    --------
    >>> is_same_rate(30.0, 29.97), is_same_rate(30.0, 25.0)
    (True, False)
    """
    return abs(a_hz - b_hz) <= SAME_RATE * max(a_hz, b_hz)


def log10_ratio(time_s: FloatArray, std_s: FloatArray, frame_s: float) -> float:
    """Return the log10 likelihood ratio of "the same read-out time" to "two cameras" (ENFSI 2015).

    Likelihoods are integrated over the prior: over one shared time, or over each time separately.

    Parameters
    ----------
    time_s, std_s : array (2,)
        The two read-out times, and their standard errors.
    frame_s : float
        Frame period, the longest read-out time.
    """
    longest_s = (1.0 + SLACK_RATIO) * frame_s
    low = max(SHORTEST_S, float(np.min(time_s - REACH * std_s)))
    high = min(longest_s, float(np.max(time_s + REACH * std_s)))
    # Denser near the estimates, whose errors may be a thousand times smaller than their distance.
    spread = np.sinh(np.linspace(-9.0, 9.0, STEPS)) / math.sinh(9.0)
    grid = np.unique(
        np.clip(np.concatenate([t + spread * (high - low) for t in time_s]), low, high)
    )
    prior = _prior(grid, longest_s)
    one, two = (_student(grid, t, s) for t, s in zip(time_s, std_s, strict=True))
    same = np.trapezoid(prior * one * two, grid)
    apart = np.trapezoid(prior * one, grid) * np.trapezoid(prior * two, grid)
    tiny = np.finfo(float).tiny
    return math.log10(max(float(same), tiny)) - math.log10(max(float(apart), tiny))


def _prior(at: FloatArray, longest_s: float) -> FloatArray:
    """Prior density of read-out times."""
    broad = 1.0 / (at * math.log(longest_s / SHORTEST_S))
    crowded = (at > CROWDED_RATIO * longest_s) / ((1.0 - CROWDED_RATIO) * longest_s)
    return np.asarray(0.25 * broad + 0.25 * crowded + 0.5 / longest_s)


def _student(at: FloatArray, centre: float, scale: float) -> FloatArray:
    """Density of Student's t."""
    half = (FREEDOM + 1.0) / 2.0
    norm = math.exp(math.lgamma(half) - math.lgamma(FREEDOM / 2.0))
    z = (at - centre) / scale
    return np.asarray(
        norm / (math.sqrt(FREEDOM * math.pi) * scale) * (1.0 + z * z / FREEDOM) ** -half
    )


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
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    def may_be(self, other: Mode) -> bool:
        """Whether a recording of the other mode may be of this one, as far as is known."""
        pairs = ((self.across_px, other.across_px), (self.crop, other.crop))
        return (
            is_same_rate(self.frame_rate_hz, other.frame_rate_hz)
            and self.lines == other.lines
            and all(a == b or not (a and b) for a, b in pairs)
        )


@dataclass(frozen=True, kw_only=True)
class ReadOutTime:
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
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    def __post_init__(self) -> None:
        for value in (self.mode.frame_rate_hz, self.read_out_time_s, self.read_out_time_std_s):
            if not SMALLEST <= value <= 1.0 / SMALLEST:
                raise ValueError(f"{value:g} s or Hz can't be")
        if not math.isfinite(self.clock_ppm or 0.0):
            raise ValueError(f"a clock error of {self.clock_ppm:g} ppm can't be")


@dataclass(frozen=True)
class Known:
    """A camera in one of its modes."""

    name: str
    mode: Mode
    readings: tuple[ReadOutTime, ...]

    @property
    def scatter_s(self) -> float:
        """Scatter between recordings beyond their stated errors (DerSimonian and Laird 1986)."""
        time_s, var = _times(self.readings)
        usual_s = USUAL_SCATTER_RATIO * float(np.average(time_s, weights=1.0 / var))
        return shrunk_std(between_var(time_s, var), time_s.size - 1, usual_s)

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


def shrunk_std(found_var: float, freedom: int, usual_std: float) -> float:
    """Return a standard deviation between recordings, shrunk to the usual one.

    Parameters
    ----------
    found_var : float
        As found between recordings, beyond their stated errors.
    freedom : int
        Recordings but one.
    usual_std : float
        Of other cameras; counts as much as ``USUAL_FREEDOM``.
    """
    total = USUAL_FREEDOM * usual_std**2 + freedom * found_var
    return math.sqrt(total / (USUAL_FREEDOM + freedom))


def _times(readings: Sequence[ReadOutTime]) -> tuple[FloatArray, FloatArray]:
    """Read-out times and their stated variances."""
    stated = np.array([(r.read_out_time_s, r.read_out_time_std_s) for r in readings])
    return stated[:, 0], stated[:, 1] ** 2


def known_modes(name: str, readings: Sequence[ReadOutTime]) -> list[Known]:
    """Group a camera's recordings by mode, in the order in which they came.

    Parameters
    ----------
    name : str
    readings : sequence of ReadOutTime
    """
    modes: dict[Mode, list[ReadOutTime]] = {}
    for reading in readings:
        key = reading.mode
        alike = (
            m for m in modes if m.may_be(key) and replace(m, frame_rate_hz=key.frame_rate_hz) == key
        )
        modes.setdefault(next(alike, key), []).append(reading)
    return [Known(name, mode, tuple(of_mode)) for mode, of_mode in modes.items()]


def log10_lr(
    known: Known, reading: ReadOutTime, same_model_ratio: float = SAME_MODEL_RATIO
) -> float:
    """Log10 likelihood ratio of "this camera" to "another of the population" (ENFSI 2015).

    Parameters
    ----------
    known : Known
    reading : ReadOutTime
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
