"""All methods on the same row blocks, against the truth: plain values, nothing concluded yet."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.idle import IdleSettings, make_idle
from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.stage import IdleStage
from rsenf.messages import EnfEstimate, IdleEstimate, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.stage import Stage
from rsenf.track import METHODS as ENF_METHODS
from rsenf.track import TrackSettings, make_tracker

MEAN_S = 1.0  # an ENF estimate is held against the mean over so long, centred on it


class Grid(Protocol):
    """What the frequency was."""

    def mean_hz(self, begin_s: FloatArray, end_s: FloatArray) -> FloatArray:
        """Mean from times to others, seconds from the first frame."""
        ...


class _Method:
    """An idle method that can be changed for another until the end of the stream."""

    name = ""

    def __call__(self, seen: EstimatorState) -> Finding:
        return IDLE_METHODS[self.name](seen)


def judge_idle(blocks: Sequence[RowBlock], true_ratio: float) -> dict[str, dict[str, Any]]:
    """Have every idle method conclude from the clip; return what each says of it, by name.

    They all conclude from the same sums, whose making is most of the work: the clip is taken in
    once, and each method has a copy of the stage to end it with. Its processor time is that of
    both, as when it runs alone.
    """
    method = _Method()
    stage = IdleStage(IdleSettings(every_s=math.inf), method)
    fed = tried(partial(_feed, stage, blocks), lambda out: {})
    if "broke" in fed:
        return dict.fromkeys(IDLE_METHODS, fed)
    found = {}
    for method.name in IDLE_METHODS:
        end = copy.deepcopy(stage).flush
        found[method.name] = tried(end, partial(_idle, true_ratio), fed["cpu_s"])
    return found


def judge_enf(blocks: Sequence[RowBlock], grid: Grid) -> dict[str, dict[str, Any]]:
    """Run every ENF method; return the usable values of each with their errors, by name."""
    return {name: enf_by(name, blocks, grid) for name in ENF_METHODS}


def enf_by(method: str, blocks: Sequence[RowBlock], grid: Grid) -> dict[str, Any]:
    """Run an ENF method; return its usable values with their errors."""
    stage = make_tracker(TrackSettings(method=method))
    return tried(lambda: _feed(stage, blocks) + stage.flush(), partial(_enf, grid))


def idle_by(method: str, blocks: Sequence[RowBlock], true_ratio: float) -> dict[str, Any]:
    """Run an idle method by itself; return what it says."""
    stage = make_idle(IdleSettings(method=method, every_s=math.inf))
    return tried(lambda: _feed(stage, blocks) + stage.flush(), partial(_idle, true_ratio))


def _feed(stage: Stage, blocks: Sequence[RowBlock]) -> list[Any]:
    return [message for block in blocks for message in stage.update(block)]


def tried(
    work: Callable[[], list[Any]],
    told: Callable[[list[Any]], dict[str, Any]],
    before_s: float = 0.0,
) -> dict[str, Any]:
    """Time some work. What breaks is a result: the others are still to be measured."""
    begin_s = time.process_time()
    try:
        out = work()
    except Exception as exc:  # noqa: BLE001  # whatever it is, it is counted and shown
        return {"broke": f"{type(exc).__name__}: {exc}"}
    return {"cpu_s": round(before_s + time.process_time() - begin_s, 4), **told(out)}


def _idle(true_ratio: float, out: list[Any]) -> dict[str, Any]:
    said = [m for m in out if isinstance(m, IdleEstimate)]
    if not said:
        return {"verdict": "no_signal", "reason": "nothing was said"}
    last = said[-1]
    return {
        "verdict": last.verdict,
        "reason": last.reason,
        "idle_percent": number(100 * last.idle_ratio),
        "error_percent": number(100 * (last.idle_ratio - true_ratio)),
        "std_percent": number(100 * root(last.idle_ratio_var)),
        "interval_percent": [number(100 * last.idle_ratio_low), number(100 * last.idle_ratio_high)],
        "direction": last.direction,
        "nominal_hz": number(last.nominal_hz),
        "warnings": list(last.warnings),
    }


def _enf(grid: Grid, out: list[Any]) -> dict[str, Any]:
    """Errors in mHz of the values that the method stands behind, with their times."""
    said = [m for m in out if isinstance(m, EnfEstimate) and m.rank == 0]
    good = [m for m in said if m.usable]
    t_s = np.array([m.t_s for m in good])
    found_hz = np.array([m.enf_hz for m in good])
    # Estimates are on the clock that the slips are undone on; the grid is on the file's.
    slipped_s = np.cumsum([m.slip_frames.sum() / m.frame_rate_hz if m.slips else 0.0 for m in said])
    after_s = np.array([late for m, late in zip(said, slipped_s, strict=True) if m.usable])
    before_s = np.append(0.0, slipped_s)[:-1][[m.usable for m in said]]
    begin_s, end_s = t_s - MEAN_S / 2 - before_s, t_s + MEAN_S / 2 - after_s
    true_hz = grid.mean_hz(begin_s, end_s) if good else found_hz
    error_hz = found_hz - true_hz
    # Where the direction of read-out is left open, either sign of the deviation is answered for.
    mirror_hz = np.array([m.mirror_hz for m in good])
    mirrored_hz = np.where(mirror_hz > 0.0, 2.0 * mirror_hz - found_hz - true_hz, error_hz)
    error_hz = min(error_hz, mirrored_hz, key=lambda error: float(error @ error))
    reasons: dict[str, int] = {}
    for m in said:
        if not m.usable:
            reasons[m.reason] = reasons.get(m.reason, 0) + 1
    return {
        "t_s": [round(t, 4) for t in t_s.tolist()],
        "error_mhz": [number(1e3 * e, 6) for e in error_hz.tolist()],
        "std_mhz": [number(1e3 * root(m.enf_var_hz2), 6) for m in good],
        "unusable": reasons,
    }


def root(variance: float) -> float:
    """Return the standard deviation; NaN for none."""
    return math.sqrt(variance) if variance >= 0 else math.nan


def number(value: float, digits: int = 8) -> float | None:
    """Return a number fit for JSON: rounded, None where it isn't finite."""
    return round(float(value), digits) if math.isfinite(value) else None
