"""All methods on the same row blocks, with their errors against the truth, as plain values."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import EnfEstimate, IdleEstimate, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.stage import Stage
from rsenf.track import METHODS as ENF_METHODS
from rsenf.track import TrackSettings, make_tracker

MEAN_S = 1.0  # an ENF estimate is compared with the mean over so long about its time


class Grid(Protocol):
    """The true frequency of the grid."""

    def mean_hz(self, begin_s: FloatArray, end_s: FloatArray) -> FloatArray:
        """Mean frequency of intervals, in seconds from the first frame."""
        ...


def judge_idle(blocks: Sequence[RowBlock], true_ratio: float) -> dict[str, dict[str, Any]]:
    """Run every idle method on a clip; return the result of each by name."""
    return {name: idle_by(name, blocks, true_ratio) for name in IDLE_METHODS}


def judge_enf(blocks: Sequence[RowBlock], grid: Grid) -> dict[str, dict[str, Any]]:
    """Run every ENF method; return the usable estimates of each with their errors, by name."""
    return {name: enf_by(name, blocks, grid) for name in ENF_METHODS}


def enf_by(method: str, blocks: Sequence[RowBlock], grid: Grid) -> dict[str, Any]:
    """Run an ENF method; return its usable estimates with their errors."""
    stage = make_tracker(TrackSettings(method=method))
    return tried(lambda: _feed(stage, blocks) + stage.flush(), partial(_enf, grid))


def idle_by(method: str, blocks: Sequence[RowBlock], true_ratio: float) -> dict[str, Any]:
    """Run one idle method; return its result."""
    stage = make_idle(IdleSettings(method=method, every_s=math.inf))
    return tried(lambda: _feed(stage, blocks) + stage.flush(), partial(_idle, true_ratio))


def _feed(stage: Stage, blocks: Sequence[RowBlock]) -> list[Any]:
    return [message for block in blocks for message in stage.update(block)]


def tried(
    work: Callable[[], list[Any]], describe: Callable[[list[Any]], dict[str, Any]]
) -> dict[str, Any]:
    """Time a method; an exception is recorded as ``broke``, and the others still run.

    Parameters
    ----------
    work : callable
        Returns messages.
    describe : callable
        From the messages to the record.
    """
    begin_s = time.process_time()
    try:
        out = work()
    except Exception as exc:  # noqa: BLE001  # counted in the table
        return {"broke": f"{type(exc).__name__}: {exc}"}
    return {"cpu_s": round(time.process_time() - begin_s, 4), **describe(out)}


def _idle(true_ratio: float, out: list[Any]) -> dict[str, Any]:
    estimates = [m for m in out if isinstance(m, IdleEstimate)]
    if not estimates:
        return {"verdict": "no_signal", "reason": "nothing was said"}
    last = estimates[-1]
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
    """Return times and errors (mHz) of the usable estimates."""
    estimates = [m for m in out if isinstance(m, EnfEstimate) and m.rank == 0]
    good = [m for m in estimates if m.usable]
    t_s = np.array([m.t_s for m in good])
    found_hz = np.array([m.enf_hz for m in good])
    # Estimates are on a clock without the slips; the grid's truth is on the file's clock.
    slipped_s = np.cumsum(
        [m.slip_frames.sum() / m.frame_rate_hz if m.slips else 0.0 for m in estimates]
    )
    after_s = np.array([late for m, late in zip(estimates, slipped_s, strict=True) if m.usable])
    before_s = np.append(0.0, slipped_s)[:-1][[m.usable for m in estimates]]
    begin_s, end_s = t_s - MEAN_S / 2 - before_s, t_s + MEAN_S / 2 - after_s
    true_hz = grid.mean_hz(begin_s, end_s) if good else found_hz
    error_hz = found_hz - true_hz
    # Where the read-out direction is unknown, the deviation may have either sign.
    mirror_hz = np.array([m.mirror_hz for m in good])
    mirrored_hz = np.where(mirror_hz > 0.0, 2.0 * mirror_hz - found_hz - true_hz, error_hz)
    error_hz = min(error_hz, mirrored_hz, key=lambda error: float(error @ error))
    reasons: dict[str, int] = {}
    for m in estimates:
        if not m.usable:
            reasons[m.reason] = reasons.get(m.reason, 0) + 1
    return {
        "t_s": [round(t, 4) for t in t_s.tolist()],
        "error_mhz": [number(1e3 * e, 6) for e in error_hz.tolist()],
        "std_mhz": [number(1e3 * root(m.enf_var_hz2), 6) for m in good],
        "unusable": reasons,
    }


def root(variance: float) -> float:
    """Return the standard deviation; NaN of a negative or NaN variance."""
    return math.sqrt(variance) if variance >= 0 else math.nan


def number(value: float, digits: int = 8) -> float | None:
    """Return a number for JSON: rounded, or None where it isn't finite."""
    return round(float(value), digits) if math.isfinite(value) else None
