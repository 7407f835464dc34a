"""One window of a stream: its rows in a buffer, the workflow on them, and a summary of the result.

The buffer holds the newest rows, averaged into lines; it is the same however they were batched. The
summary is for publication and for comparison.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.discrepancy.fit_parameters import series_of
from rsenf.discrepancy.lines import averaged, group_of
from rsenf.discrepancy.measured import Measured, measured_of
from rsenf.discrepancy.result import SURE
from rsenf.discrepancy.settings import FEWEST_LINES
from rsenf.discrepancy.verdict import Discovery, discover
from rsenf.errors import InputError, UsageError
from rsenf.messages import FoundEffect, Header, RowBlock
from rsenf.model import CaptureModel, Effect
from rsenf.model.parameters import fittings

BLOCK_FRAMES = 8
FEWEST_THERE = 2.0 / 3.0  # of a window's frames
Value = tuple[float, float]  # value, standard error
MOST_PLACES = 3
GONE_STDS = 4.0  # distance from neutral within which an effect counts as gone


class WindowBuffer:
    """Rows of one shape; a block of another shape empties it first.

    Parameters
    ----------
    lines : int
        Largest number of lines of a frame.
    """

    def __init__(self, lines: int) -> None:
        self._lines = lines
        self._blocks: deque[RowBlock] = deque()

    def add(self, block: RowBlock) -> None:
        """Add the newest frames."""
        thin = thinned(block, self._lines)
        if self._blocks and _shape(self._blocks[0]) != _shape(thin):
            self._blocks.clear()
        self._blocks.append(thin)

    def forget_before(self, pts_ns: int) -> None:
        """Drop frames before a time of the stream."""
        while self._blocks and self._blocks[0].frame_pts_ns[0] < pts_ns:
            oldest = self._blocks.popleft()
            kept = int(np.searchsorted(oldest.frame_pts_ns, pts_ns))
            if kept < oldest.frames:
                self._blocks.appendleft(part_of(oldest, kept, oldest.frames))

    @property
    def header(self) -> Header | None:
        """Header that covers all of its frames; None if empty."""
        return joined(self._blocks).header if self._blocks else None

    @property
    def span_ns(self) -> int:
        """Time from the first frame to the last."""
        if not self._blocks:
            return 0
        return int(self._blocks[-1].frame_pts_ns[-1] - self._blocks[0].frame_pts_ns[0])

    def blocks(self) -> list[RowBlock]:
        """Return all rows in blocks of ``BLOCK_FRAMES``, with time stamps from the first frame."""
        if not self._blocks:
            return []
        whole = joined(self._blocks)
        since_start = whole.frame_pts_ns - whole.frame_pts_ns[0]
        whole = dataclasses.replace(whole, frame_pts_ns=since_start)
        firsts = range(0, whole.frames, BLOCK_FRAMES)
        return [part_of(whole, k, min(k + BLOCK_FRAMES, whole.frames)) for k in firsts]


def thinned(block: RowBlock, lines: int) -> RowBlock:
    """Average neighbouring rows of a block into at most ``lines`` lines."""
    group = min(group_of(block.rows, lines), max(block.rows // FEWEST_LINES, 1))
    if group == 1:
        return block
    kept = block.rows // group
    pixels = block.kept_px[: kept * group].reshape(kept, group, block.strips)
    level, kept_px = averaged(block.level, group), pixels.sum(axis=1, dtype=np.uint32)
    return dataclasses.replace(block, rows=kept, level=level, kept_px=kept_px)


def part_of(block: RowBlock, first: int, end: int) -> RowBlock:
    """Return the frames ``first`` to ``end − 1`` of a block, by index."""
    part = slice(first, end)
    header = block.header.at(
        int(block.frame_pts_ns[first]),
        frame_first=int(block.frame_number[first]),
        frame_last=int(block.frame_number[end - 1]),
    )
    return dataclasses.replace(
        block,
        header=header,
        frames=end - first,
        frame_number=block.frame_number[part],
        frame_pts_ns=block.frame_pts_ns[part],
        level=block.level[part],
        tile_level=block.tile_level[part],
    )


def joined(blocks: Sequence[RowBlock]) -> RowBlock:
    """Join successive blocks of one shape."""
    first, last = blocks[0], blocks[-1]
    return dataclasses.replace(
        first,
        header=dataclasses.replace(
            last.header,
            frame_first=int(first.frame_number[0]),
            pts_ns=int(first.frame_pts_ns[0]),
            camera_time_ns=first.header.camera_time_ns,
        ),
        frames=sum(block.frames for block in blocks),
        frame_number=np.concatenate([block.frame_number for block in blocks]),
        frame_pts_ns=np.concatenate([block.frame_pts_ns for block in blocks]),
        level=np.concatenate([block.level for block in blocks]),
        tile_level=first.tile_level[:0],
        bands=0,
        tiles=0,
    )


def _shape(block: RowBlock) -> tuple[str, int, int]:
    return block.read_out_axis, block.rows, block.strips


@dataclass(frozen=True, eq=False)
class Look:
    """Result of one window."""

    found: Discovery
    gap_before: float  # with the first of the initial models


def look(
    blocks: Sequence[RowBlock], models: Sequence[CaptureModel], nominal_hz: float | None
) -> Look:
    """Run the workflow on a window, from each initial model in turn until nothing is unexplained.

    Parameters
    ----------
    blocks : sequence of RowBlock
        With time stamps from the window's start.
    models : sequence of CaptureModel
        Initial models, the likeliest first.
    nominal_hz : float, optional
        50 or 60; by default found from the rows.

    Raises
    ------
    InputError
        When there is too little data, or no flicker.
    """
    data = measured_of(blocks, nominal_hz)
    if data.frames < FEWEST_THERE * (missing_in(data) + data.frames):
        problem = f"{missing_in(data)} frames never came or are of no use, {data.frames} did"
        raise InputError(problem)
    tries: list[Discovery] = []
    for model in models:
        try:
            tries.append(discover(model, data))
        except (UsageError, np.linalg.LinAlgError):  # steps have led to an invalid model
            continue
        if tries[-1].verdict != "unexplained":
            break
    if not tries:
        raise InputError("no fit of the model to these rows is found")
    best = min(tries, key=lambda t: (t.verdict == "unexplained", abs(t.last.gap.value)))
    return Look(best, tries[0].gap_before)


def missing_in(data: Measured) -> int:
    """Number of frames missing between the first and the last."""
    return int(data.slot[-1]) + 1 - data.frames


@dataclass(frozen=True, eq=False)
class WindowSummary:
    """Result of one window."""

    verdict: str
    model: CaptureModel  # as found, without effects of earlier windows that are gone
    effects: tuple[FoundEffect, ...]  # effects of the model beyond those of the initial one
    values: dict[tuple[str, str], Value]  # fitted values by part and name


def seen_in(found: Discovery, given: CaptureModel, known: Sequence[FoundEffect]) -> WindowSummary:
    """Summarise a window.

    Parameters
    ----------
    found : Discovery
    given : CaptureModel
        Initial model of the first window.
    known : sequence of FoundEffect
        Effects of the window before, whose classes are kept.
    """
    values = _values(found)
    added = {e.members[0] if e.members else e.name: e for e in _added(found)}
    classes = {name: effect.members for effect in known for name in names_of(effect)}
    model, effects = found.last.forward.model, []
    for effect in model.effects:
        if effect.name in {old.name for old in given.effects}:
            continue
        if effect.name not in added and _does_nothing(effect, values):
            model = model.without(effect.name)
            continue
        members = classes.get(effect.name, ())
        blank = FoundEffect(name="" if members else effect.name, members=members)
        effects.append(_with_values(added.get(effect.name, blank), effect, values))
    parts = {"light", "shutter", *(effect.name for effect in model.effects)}
    values = {key: value for key, value in values.items() if key[0] in parts}
    return WindowSummary(found.verdict, model, tuple(effects), values)


def names_of(effect: FoundEffect) -> tuple[str, ...]:
    """All names that a found effect may have."""
    return effect.members or (effect.name,)


def rest_of(found: Discovery, gap_before: float) -> dict[str, Any]:
    """Return the message fields on what is unexplained, given the initial model's gap."""
    places = sorted((p for p in found.after if p.sure > SURE), key=lambda p: -p.share)
    lines = [p for p in places if p.axis == "alias_hz"]
    text = "; ".join(
        f"{100.0 * p.share:.0f} % of it at {p.axis} {p.low:.4g} to {p.high:.4g}"
        for p in places[:MOST_PLACES]
    )
    return {
        "unexplained_freq_hz": (lines[0].low + lines[0].high) / 2.0 if lines else math.nan,
        "unexplained_ratio": found.gap_after / gap_before,
        "unexplained_text": text,
    }


def _added(found: Discovery) -> Iterator[FoundEffect]:
    """Effects that the window added; in a class the fitted one comes first."""
    for step in found.steps:
        best = step.chosen
        assert best is not None
        yield FoundEffect(
            name=best.effect.name if len(step.equivalents) == 1 else "",
            members=step.equivalents if len(step.equivalents) > 1 else (),
            gap_before=step.before.gap.value,
            gap_after=best.fit.gap.value,
            evidence=best.nats / step.limit,
        )


def _with_values(
    blank: FoundEffect, effect: Effect, values: dict[tuple[str, str], Value]
) -> FoundEffect:
    """Fill in an effect's parameters, and the standard errors of the fitted ones."""
    parameters = dict(_parameters(effect))
    errors = [values.get((effect.name, name), (0.0, math.nan))[1] for name in parameters]
    return dataclasses.replace(
        blank,
        parameter_names=tuple(parameters),
        parameters=np.array(list(parameters.values()), np.float64),
        parameter_std=np.array(errors, np.float64),
    )


def _parameters(effect: Effect) -> Iterator[tuple[str, float]]:
    """Parameters of an effect as numbers: the rms of a series, the members of a list."""
    series = series_of(effect)
    for name, value in effect.to_dict().items():
        if series and name == series[0]:
            yield f"{name}.rms", float(np.sqrt(np.mean(np.square(value))))
        elif isinstance(value, list):
            yield from ((f"{name}.{k}", float(v)) for k, v in enumerate(value))
        elif isinstance(value, int | float):
            yield name, float(value)


def _values(found: Discovery) -> dict[tuple[str, str], Value]:
    """Fitted values; for a complex amplitude its size, with the larger error of its components."""
    out: dict[tuple[str, str], Value] = {}
    model = found.last.forward.model
    for parameter, error in zip(found.last.parameters, found.last.stderr, strict=True):
        key = (
            parameter.part,
            parameter.name + (f".{parameter.index}" if parameter.index >= 0 else ""),
        )
        value = parameter.value(model)
        out[key] = value, max(float(error), out.get(key, (value, 0.0))[1])
    return out


def _does_nothing(effect: Effect, values: dict[tuple[str, str], Value]) -> bool:
    """Whether all fitted parameters of an effect are neutral within their errors."""
    tells = [(name, f.neutral) for name, f in fittings(effect).items() if f.neutral is not None]
    fitted = [
        (*value, neutral)
        for name, neutral in tells
        for (part, key), value in values.items()
        if part == effect.name and key.split(".")[0] == name
    ]
    return bool(fitted) and all(abs(v - neutral) < GONE_STDS * e for v, e, neutral in fitted)
