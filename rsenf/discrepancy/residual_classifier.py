"""Classifies an unexplained residual by features that separate kinds of causes.

The class is a guess: it says where to look next and which measurement would tell, and adds nothing
to the model.

Model: the residual is a systematic part, which two neighbouring lines share, plus independent
noise. Each class lets the systematic part be of one form: a course along a direction (gain, phase,
flicker), a function of the level, a step or burst in time, a tone.

Statistic: the share of the systematic power that a form explains, ``Σ â·b̂ / Σ a·b`` of neighbours'
residuals ``a``, ``b`` and their fits, as in the gap, so noise doesn't bias it. The first form, in
order from the most specific, that explains about half is the class. Where hardly anything fits, or
neighbours err in opposite ways, that alone is the class.

Approximate: thresholds and their order are set by hand; no probability of a class is stated.

References
----------
Anscombe, F. J. and Tukey, J. W. (1963), The examination and analysis of residuals, Technometrics 5.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.gap import products
from rsenf.discrepancy.measured import BANDS, Float32Array
from rsenf.discrepancy.residual_breakdown import (
    HARMONICS,
    Alias,
    ResidualShare,
    flicker_hz,
    is_at,
    tone_of,
)
from rsenf.discrepancy.series import best_step, halves, power
from rsenf.messages.schema import FloatArray
from rsenf.model.effects.search import NOTHING_FITS
from rsenf.model.parameters import Fitting

_ANOTHER = "a second reference of the same time: what is the camera's is there against both"

TELLS: dict[str, tuple[str, ...]] = {
    "other_readout": (
        "a recording of one small, fast LED: in which order and when the camera reads its lines",
        "another model to begin with (--model), with this camera's read-out",
    ),
    "single_lines": (
        "an evenly lit, still wall, out of focus: what each line does is then seen by itself",
        "the same at half the light: a fault of the lines' gain halves, one of their offset stays",
    ),
    "event": (
        "the frames and their time stamps about that time",
        "a second recording: whether it comes again, and whether at the same time after the start",
    ),
    "tone": (
        "a recording at another frame rate: its alias moves, and only one frequency fits both",
        "daylight in place of the lamp: what stays is the camera's, not the light's",
        "the camera on something heavy: what goes was shaking",
    ),
    "fast_tone": (
        "a recording at another frame rate: its alias moves, and only one frequency fits both",
        "the lamp before a photodiode: its driver's frequency is there to read",
        "each lamp and screen by itself: which of them it is",
    ),
    "level": (
        "a bright and a dark wall side by side: a tone curve follows the level everywhere alike",
        "a stop less of exposure: clipping goes, a tone curve stays",
    ),
    "waveform": (
        "a bright and a dark wall side by side: the lamp's waveform is the same on both",
        "the lamp before a photodiode: its waveform without a camera's tone curve",
    ),
    "flicker": (
        "each lamp by itself, and strips of the picture apart: a second lamp on another phase "
        "differs from place to place",
        "another exposure time: what the shutter does changes, what the lamps do stays",
    ),
    "gain": (
        "fixed exposure and white balance: what goes was the camera's",
        "a second light that doesn't flicker, on part of the wall: a gain scales both, light "
        "only its own",
    ),
    "timing": (
        "the sensor's own time stamp of each frame, or a running clock in the picture",
        "a reference of the grid: what the light did and what the camera's clock did",
    ),
    "flicker_size": (
        "the camera's own file at a higher bit rate, or uncompressed: what goes was the codec's",
        "a fixed exposure time: the flicker's size follows it",
    ),
    "frame_by_frame": (
        "the sensor's own time stamp of each frame",
        "fixed exposure, and a second light that doesn't flicker on part of the wall",
    ),
    "rows": (
        "the camera upside down: what moves with the picture is the scene's, the rest the camera's",
    ),
    "strips": (
        "each lamp by itself, and the picture in more strips: which side has what",
        "the camera turned by a quarter: what depends on the side then depends on the row",
    ),
    "clock_drift": (
        _ANOTHER,
        "a recording begun once the camera is warm: a crystal drifts with its temperature",
    ),
    "lag_step": ("the frames and their time stamps about that time", _ANOTHER),
    "wander": ("the sensor's own time stamp of each frame", _ANOTHER),
    "other_course": (
        _ANOTHER,
        "a still, evenly lit wall: what moves in the picture pulls at the light's phase",
    ),
    "unknown": ("a longer recording of a still, evenly lit wall", "another frame rate"),
}


EACH_FRAME = Fitting(0.0, 1.0, each="frame")
LEVELS = 32  # steps of the curve over level
BIN_S = 0.5  # bin width of the event search
EDGE = 5  # frames at either end where no change point is sought
LONGEST_S = 4.0  # longest period that is sought
REPEATS, DIPS = 0.7, 0.5  # autocorrelation: least at the period, and most in between
MOST = 0.5  # share of the residual above which a feature determines the class
CURVE = 0.4  # the same for a function of level, part of which the fitted wall absorbs
LASTING = 0.8
SLOW = 0.5  # lag-1 autocorrelation above which a series wanders
WHITE = (0.8, 1.2)  # ``step`` share of a residual that is white in time
FEW_BANDS = BANDS / 2  # effective number of bands below which the residual is local
COMMON = 0.7
SHAKING_HZ = 60.0  # a faster tone is neither motion nor a gain of whole frames


@dataclass(frozen=True, eq=False)
class Series:
    """A series with one value a frame, multiplying a given direction, fitted to the residual."""

    share: float  # share of the residual that it explains
    stays: float  # autocorrelation at lag 1: 0 for white, 1 for slow
    changed: float  # share of the series' variance that one lasting step explains
    changed_s: float  # time of that step
    period_frames: int  # period; 0 if not periodic


@dataclass(frozen=True, eq=False)
class FittedFeatures:
    """Features of a residual."""

    gain: Series  # brightness of a frame; phase of its light; amplitude of its flicker
    timing: Series
    flicker_size: Series
    level: float  # share that is a function of the predicted level
    common: float  # share that all strips have in common; 1 for a single strip
    # centres of the half seconds that hold half of the residual, if they are few; else empty
    burst_s: tuple[float, ...]


def signs_of(fit: Fit) -> FittedFeatures:
    """Compute the features of a fit's residual."""
    first, second = fit.data.halves(fit.residual)
    total = float((first * second).sum(dtype=np.float64)) or 1e-30
    strips = first.shape[2] * (first.mean(axis=2) * second.mean(axis=2)).sum(dtype=np.float64)
    return FittedFeatures(
        _series(fit, fit.jacobian.lit, total),
        _series(fit, fit.jacobian.turn, total),
        _series(fit, fit.flicker, total),
        _by_level(fit, first, second) / total,
        float(strips) / total,
        _bursts(fit),
    )


def _series(fit: Fit, direction: Float32Array, total: float) -> Series:
    """Fit a series along a direction, from either half of the lines."""
    lit, data = fit.jacobian.lit, fit.data
    a, b = halves(direction, fit.residual, lit, data, EACH_FRAME)
    # The power is of all lines or strips, the products are of pairs of them.
    size = direction.shape[data.apart]
    share = float((a * b * power(direction, lit, EACH_FRAME)).sum()) * (size // 2) / size / total
    a, b = a - a.mean(), b - b.mean()
    shared = float(a @ b)
    if shared <= 0.0:
        return Series(share, 0.0, 0.0, 0.0, 0)
    changed, at = best_step(a, b, EDGE)
    apart = _apart(a, b, math.ceil(LONGEST_S * float(data.frame_rate))) / shared
    at_s = float(data.time_s[at])
    return Series(share, float(apart[1]), changed / shared, at_s, _period(apart))


def _apart(a: FloatArray, b: FloatArray, most: int) -> FloatArray:
    """Unbiased cross-products of two series by lag in frames, up to ``most``."""
    size = a.size
    return np.array([(a[n:] @ b[: size - n]) * size / (size - n) for n in range(min(most, size))])


def _period(apart: FloatArray) -> int:
    """Lag of the first autocorrelation peak after a dip, in frames; 0 if there is none."""
    fallen = np.flatnonzero(apart < DIPS)
    inner = apart[1:-1]
    peaks = (inner > REPEATS) & (inner >= apart[:-2]) & (inner >= apart[2:])
    again = 1 + np.flatnonzero(peaks)
    again = again[again > fallen[0]] if fallen.size else again[:0]
    return int(again[0]) if again.size else 0


def _by_level(fit: Fit, first: Float32Array, second: Float32Array) -> float:
    """Sum of products explained by a function of the predicted level."""
    edges = np.quantile(fit.rows, np.linspace(0.0, 1.0, LEVELS + 1)[1:-1])
    means, counts = [], []
    for rows, residual in zip(fit.data.halves(fit.rows), (first, second), strict=True):
        bin_of = np.digitize(rows, edges).ravel()
        counts.append(np.bincount(bin_of, minlength=LEVELS))
        means.append(np.bincount(bin_of, residual.ravel(), LEVELS) / np.maximum(counts[-1], 1))
    return float((means[0] * means[1] * counts[0]).sum())


def _bursts(fit: Fit) -> tuple[float, ...]:
    number = (fit.data.time_s // BIN_S).astype(np.intp)
    held = np.bincount(number, products(fit.residual, fit.data))
    order = np.argsort(-held)
    few = int(np.argmax(np.cumsum(held[order]) >= held.sum() / 2.0)) + 1
    if held.sum() <= 0.0 or few > held.size // 10:
        return ()
    return tuple(float(n + 0.5) * BIN_S for n in np.sort(order[:few]))


@dataclass(frozen=True)
class ResidualClass:
    """Class of an unexplained residual."""

    kind: str  # a key of ``TELLS``
    also: tuple[str, ...] = ()  # further classes that apply, also keys
    # measurements that would identify the cause, the most useful first
    would_tell: tuple[str, ...] = ()
    tone: Alias | None = None
    at_s: tuple[float, ...] = ()  # times of an event
    # first and last of the rows that hold most of it, if few do; else empty
    rows: tuple[float, ...] = ()
    period_frames: int = 0  # period of a series; 0 if not periodic
    # for a series with one value a frame: whether it wanders (True) or jumps
    slow: bool | None = None


def hint_of(last: Fit, after: Sequence[ResidualShare]) -> ResidualClass:
    """Classify the residual of a recording that isn't explained.

    Parameters
    ----------
    last : Fit
        The final fit.
    after : sequence of ResidualShare
        Its :func:`rsenf.discrepancy.residual_breakdown.where`.
    """
    if abs(last.gap.value) > NOTHING_FITS:
        return _hint(["other_readout"])
    if last.gap.value < 0.0:
        return _hint(["single_lines"])
    signs = signs_of(last)
    when = _when(last, after, signs)
    rows = _rows(after)
    places = ["rows"] * bool(rows) + ["strips"] * (signs.common < COMMON)
    kinds = [*([] if when.kind == "unknown" else [when.kind]), *places] or ["unknown"]
    return dataclasses.replace(
        _hint(kinds), tone=when.tone, at_s=when.at_s, rows=rows,
        period_frames=when.period_frames, slow=when.slow,
    )  # fmt: skip


def hint_json(hint: ResidualClass) -> dict[str, Any]:
    """Return a class as plain values; those of a tone only if there is one."""
    values = {**vars(hint), **(vars(hint.tone) if hint.tone else {})}
    del values["tone"]
    return {name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}


def _hint(kinds: Sequence[str]) -> ResidualClass:
    would_tell = tuple(text for kind in kinds for text in TELLS[kind])
    return ResidualClass(kinds[0], tuple(kinds[1:]), would_tell)


def _when(last: Fit, after: Sequence[ResidualShare], signs: FittedFeatures) -> ResidualClass:
    """Classify the residual by its course in time, the most specific class first."""
    series = {"gain": signs.gain, "timing": signs.timing, "flicker_size": signs.flicker_size}
    for one in series.values():
        if one.share > MOST and one.changed > LASTING:
            return ResidualClass("event", at_s=(one.changed_s,))
    if signs.burst_s:
        return ResidualClass("event", at_s=signs.burst_s)
    lines = [share for share in after if share.axis == "alias_hz"]
    tone = tone_of(last, lines)
    if tone:
        fast = bool(tone.likely_hz) and tone.likely_hz[0] > SHAKING_HZ
        return ResidualClass("fast_tone" if fast else "tone", tone=tone)
    if signs.level > CURVE:
        return ResidualClass("level")
    kind, most = max(series.items(), key=lambda item: item[1].share)
    if most.share > MOST:
        slow = None if most.period_frames else most.stays > SLOW
        return ResidualClass(kind, period_frames=most.period_frames, slow=slow)
    for kind, harmonics in (("waveform", range(2, HARMONICS + 1)), ("flicker", range(1, 2))):
        expected_hz = flicker_hz(last, harmonics)
        if sum(line.share for line in lines if is_at(line, expected_hz)) > MOST:
            return ResidualClass(kind)
    step = next(share.share for share in after if share.axis == "step")
    if WHITE[0] < step < WHITE[1] and sum(line.share for line in lines) < MOST:
        return ResidualClass("frame_by_frame")
    return ResidualClass("unknown")


def _rows(after: Sequence[ResidualShare]) -> tuple[float, ...]:
    """Return the first and last of the rows that hold most of the residual, if few do."""
    bands = [share for share in after if share.axis == "row"]
    size = np.abs([band.share for band in bands])
    if size.sum() ** 2 / (size**2).sum() > FEW_BANDS:
        return ()
    most = [band for band, magnitude in zip(bands, size, strict=True) if magnitude > size.mean()]
    return most[0].low, most[-1].high
