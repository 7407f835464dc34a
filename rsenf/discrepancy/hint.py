"""A guess of what kind of thing is left where no effect explains it, and what would tell.

A guess is no finding: it says where to look next, and adds nothing to the model.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.measured import BANDS
from rsenf.discrepancy.signs import Signs, signs_of
from rsenf.discrepancy.tone import HARMONICS, Tone, flicker_hz, is_at, tone_of
from rsenf.discrepancy.where import Share
from rsenf.discrepancy.would_tell import TELLS
from rsenf.model.effects.residue import NOTHING_FITS

MOST = 0.5  # of what is left, from which on a sign is what it is about
CURVE = 0.4  # likewise of a curve by level, of which the wall takes a part
LASTING = 0.8
SLOW = 0.5  # correlation from frame to frame from which on a series wanders
WHITE = (0.8, 1.2)  # share of what changes from frame to frame
FEW_BANDS = BANDS / 2  # of rows that hold what is left
COMMON = 0.7
SHAKING_HZ = 60.0  # from which on it is no motion, and no gain of whole frames


@dataclass(frozen=True)
class Hint:
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


def hint_of(last: Fit, after: Sequence[Share]) -> Hint:
    """Guess what is left of a recording that isn't explained.

    Parameters
    ----------
    last : Fit
        That leaves it.
    after : sequence of Share
        Where it is left, of :func:`rsenf.discrepancy.where.where`.
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


def hint_json(hint: Hint) -> dict[str, Any]:
    """Return plain values; those of a tone only where there is one."""
    told = {**vars(hint), **(vars(hint.tone) if hint.tone else {})}
    del told["tone"]
    return {name: list(v) if isinstance(v, tuple) else v for name, v in told.items()}


def _hint(kinds: Sequence[str]) -> Hint:
    return Hint(kinds[0], tuple(kinds[1:]), tuple(text for kind in kinds for text in TELLS[kind]))


def _when(last: Fit, after: Sequence[Share], signs: Signs) -> Hint:
    """Say how what is left goes in time, the most particular first."""
    series = {"gain": signs.gain, "timing": signs.timing, "flicker_size": signs.flicker_size}
    for told in series.values():
        if told.share > MOST and told.changed > LASTING:
            return Hint("event", at_s=(told.changed_s,))
    if signs.burst_s:
        return Hint("event", at_s=signs.burst_s)
    lines = [share for share in after if share.axis == "alias_hz"]
    tone = tone_of(last, lines)
    if tone:
        fast = bool(tone.likely_hz) and tone.likely_hz[0] > SHAKING_HZ
        return Hint("fast_tone" if fast else "tone", tone=tone)
    if signs.level > CURVE:
        return Hint("level")
    kind, most = max(series.items(), key=lambda item: item[1].share)
    if most.share > MOST:
        slow = None if most.period_frames else most.stays > SLOW
        return Hint(kind, period_frames=most.period_frames, slow=slow)
    for kind, harmonics in (("waveform", range(2, HARMONICS + 1)), ("flicker", range(1, 2))):
        own = flicker_hz(last, harmonics)
        if sum(line.share for line in lines if is_at(line, own)) > MOST:
            return Hint(kind)
    step = next(share.share for share in after if share.axis == "step")
    if WHITE[0] < step < WHITE[1] and sum(line.share for line in lines) < MOST:
        return Hint("frame_by_frame")
    return Hint("unknown")


def _rows(after: Sequence[Share]) -> tuple[float, ...]:
    """Return from where to where the rows are that hold most, if few do."""
    bands = [share for share in after if share.axis == "row"]
    size = np.abs([band.share for band in bands])
    if size.sum() ** 2 / (size**2).sum() > FEW_BANDS:
        return ()
    most = [band for band, own in zip(bands, size, strict=True) if own > size.mean()]
    return most[0].low, most[-1].high
