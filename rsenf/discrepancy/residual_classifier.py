"""A guess of what kind of thing is left where no effect explains it, and what would tell.

A guess is no finding: it says where to look next, and adds nothing to the model.

What is left of a recording, measured in ways that tell one kind of cause from another.

Everything is a share of the systematic residual, from products of neighbouring rows as the gap is,
so noise has none of it.
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
from rsenf.discrepancy.next_measurement import TELLS
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.series import halves, power
from rsenf.discrepancy.tone import HARMONICS, Tone, flicker_hz, is_at, tone_of
from rsenf.messages.schema import FloatArray
from rsenf.model.effects.residue import NOTHING_FITS
from rsenf.model.parameters import Fitting

EACH_FRAME = Fitting(0.0, 1.0, each="frame")
LEVELS = 32  # steps of the curve by level
BIN_S = 0.5  # in which events are looked for
EDGE = 5  # frames at either end, in which a change would be of few frames
LONGEST_S = 4.0  # period that is looked for
REPEATS, DIPS = 0.7, 0.5  # correlation a period apart, and what it must have fallen below between


@dataclass(frozen=True, eq=False)
class Series:
    """What one number for each frame would explain.

    Attributes
    ----------
    share : float
        Of what is left.
    stays : float
        Correlation of one frame's number with the next one's: 0 is by chance, 1 is slow.
    changed : float
        Share of the numbers' variance that one lasting change explains.
    changed_s : float
        When that would be.
    period_frames : int
        After how many frames the numbers come again; 0 where they don't.
    """

    share: float
    stays: float
    changed: float
    changed_s: float
    period_frames: int


@dataclass(frozen=True, eq=False)
class ResidualFeatures:
    """What tells causes apart.

    Attributes
    ----------
    gain, timing, flicker_size : Series
        All of a frame brighter; its light later; its flicker larger.
    level : float
        Share that is a curve over the level that the theory foretells.
    common : float
        Share that all strips have in common; one where there is one strip.
    burst_s : tuple of float
        Middles of the half seconds that hold half of what is left, if these are few; else empty.
    """

    gain: Series
    timing: Series
    flicker_size: Series
    level: float
    common: float
    burst_s: tuple[float, ...]


def signs_of(fit: Fit) -> ResidualFeatures:
    """Measure what a fit leaves."""
    first, second = fit.data.halves(fit.residual)
    total = float((first * second).sum(dtype=np.float64)) or 1e-30
    strips = first.shape[2] * (first.mean(axis=2) * second.mean(axis=2)).sum(dtype=np.float64)
    return ResidualFeatures(
        _series(fit, fit.slopes.lit, total),
        _series(fit, fit.slopes.turn, total),
        _series(fit, fit.flicker, total),
        _by_level(fit, first, second) / total,
        float(strips) / total,
        _bursts(fit),
    )


def _series(fit: Fit, direction: Float32Array, total: float) -> Series:
    """Weigh a direction with a size of its own in each frame, found on either half of the rows."""
    lit, data = fit.slopes.lit, fit.data
    a, b = halves(direction, fit.residual, lit, data, EACH_FRAME)
    # Half of the power is that of one row in two.
    share = float((a * b * power(direction, lit, EACH_FRAME)).sum()) / 2.0 / total
    a, b = a - a.mean(), b - b.mean()
    own = float(a @ b)
    if own <= 0.0:
        return Series(share, 0.0, 0.0, 0.0, 0)
    changed, at = _change(a, b)
    apart = _apart(a, b, math.ceil(LONGEST_S * float(data.frame_rate))) / own
    at_s = float(data.time_s[at])
    return Series(share, float(apart[1]), changed / own, at_s, _period(apart))


def _change(a: FloatArray, b: FloatArray) -> tuple[float, int]:
    """What one lasting change explains of two centred series at most, and where it is."""
    before = np.arange(1, a.size)
    told = np.cumsum(a)[:-1] * np.cumsum(b)[:-1] * a.size / (before * (a.size - before))
    at = int(np.argmax(told[EDGE:-EDGE])) + EDGE
    return float(told[at]), at + 1


def _apart(a: FloatArray, b: FloatArray, most: int) -> FloatArray:
    """Products of two series so many frames apart, as many as there would be if none were lost."""
    size = a.size
    return np.array([(a[n:] @ b[: size - n]) * size / (size - n) for n in range(min(most, size))])


def _period(apart: FloatArray) -> int:
    """Frames after which a series comes again, having been something else between."""
    fallen = np.flatnonzero(apart < DIPS)
    inner = apart[1:-1]
    peaks = (inner > REPEATS) & (inner >= apart[:-2]) & (inner >= apart[2:])
    again = 1 + np.flatnonzero(peaks)
    again = again[again > fallen[0]] if fallen.size else again[:0]
    return int(again[0]) if again.size else 0


def _by_level(fit: Fit, first: Float32Array, second: Float32Array) -> float:
    """Sum of the products that a curve over the foretold level explains."""
    edges = np.quantile(fit.rows, np.linspace(0.0, 1.0, LEVELS + 1)[1:-1])
    means, counts = [], []
    for rows, left in zip(fit.data.halves(fit.rows), (first, second), strict=True):
        own = np.digitize(rows, edges).ravel()
        counts.append(np.bincount(own, minlength=LEVELS))
        means.append(np.bincount(own, left.ravel(), LEVELS) / np.maximum(counts[-1], 1))
    return float((means[0] * means[1] * counts[0]).sum())


def _bursts(fit: Fit) -> tuple[float, ...]:
    number = (fit.data.time_s // BIN_S).astype(np.intp)
    held = np.bincount(number, products(fit.residual, fit.data))
    order = np.argsort(-held)
    few = int(np.argmax(np.cumsum(held[order]) >= held.sum() / 2.0)) + 1
    if held.sum() <= 0.0 or few > held.size // 10:
        return ()
    return tuple(float(n + 0.5) * BIN_S for n in np.sort(order[:few]))


MOST = 0.5  # of what is left, from which on a sign is what it is about
CURVE = 0.4  # likewise of a curve by level, of which the wall takes a part
LASTING = 0.8
SLOW = 0.5  # correlation from frame to frame from which on a series wanders
WHITE = (0.8, 1.2)  # share of what changes from frame to frame
FEW_BANDS = BANDS / 2  # of rows that hold what is left
COMMON = 0.7
SHAKING_HZ = 60.0  # from which on it is no motion, and no gain of whole frames


@dataclass(frozen=True)
class ResidualClass:
    """A guess of what is left.

    Attributes
    ----------
    kind : str
        A key of ``TELLS``.
    also : tuple of str
        What else holds of it, such keys too.
    would_tell : tuple of str
        Further measurements that would, the most useful first.
    tone : Tone or None
    at_s : tuple of float
        Of an event, when.
    rows : tuple of float
        First and last of those that hold most of it, if few do; else empty.
    period_frames : int
        After which it comes again; 0 where it doesn't.
    slow : bool or None
        Of one number for each frame, whether it wanders, rather than jumps.
    """

    kind: str
    also: tuple[str, ...] = ()
    would_tell: tuple[str, ...] = ()
    tone: Tone | None = None
    at_s: tuple[float, ...] = ()
    rows: tuple[float, ...] = ()
    period_frames: int = 0
    slow: bool | None = None


def hint_of(last: Fit, after: Sequence[ResidualShare]) -> ResidualClass:
    """Guess what is left of a recording that isn't explained.

    Parameters
    ----------
    last : Fit
        That leaves it.
    after : sequence of ResidualShare
        Where it is left, of :func:`rsenf.discrepancy.residual_breakdown.where`.
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
    """Return plain values; those of a tone only where there is one."""
    told = {**vars(hint), **(vars(hint.tone) if hint.tone else {})}
    del told["tone"]
    return {name: list(v) if isinstance(v, tuple) else v for name, v in told.items()}


def _hint(kinds: Sequence[str]) -> ResidualClass:
    return ResidualClass(
        kinds[0], tuple(kinds[1:]), tuple(text for kind in kinds for text in TELLS[kind])
    )


def _when(last: Fit, after: Sequence[ResidualShare], signs: ResidualFeatures) -> ResidualClass:
    """Say how what is left goes in time, the most particular first."""
    series = {"gain": signs.gain, "timing": signs.timing, "flicker_size": signs.flicker_size}
    for told in series.values():
        if told.share > MOST and told.changed > LASTING:
            return ResidualClass("event", at_s=(told.changed_s,))
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
        own = flicker_hz(last, harmonics)
        if sum(line.share for line in lines if is_at(line, own)) > MOST:
            return ResidualClass(kind)
    step = next(share.share for share in after if share.axis == "step")
    if WHITE[0] < step < WHITE[1] and sum(line.share for line in lines) < MOST:
        return ResidualClass("frame_by_frame")
    return ResidualClass("unknown")


def _rows(after: Sequence[ResidualShare]) -> tuple[float, ...]:
    """Return from where to where the rows are that hold most, if few do."""
    bands = [share for share in after if share.axis == "row"]
    size = np.abs([band.share for band in bands])
    if size.sum() ** 2 / (size**2).sum() > FEW_BANDS:
        return ()
    most = [band for band, own in zip(bands, size, strict=True) if own > size.mean()]
    return most[0].low, most[-1].high
