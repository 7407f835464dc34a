"""Initial values for a fit: ENF and idle period of the rows, as rsenf's estimators find them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.lines import averaged, group_of
from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

MOST_LINES = 240  # lines of a frame that the estimators get


@dataclass(frozen=True, eq=False)
class Estimates:
    """ENF and idle period of a recording.

    Attributes
    ----------
    enf : tuple of EnfEstimate
    idle_ratio : float
        NaN if unknown.
    nominal_hz : float
        50 or 60.
    """

    enf: tuple[EnfEstimate, ...]
    idle_ratio: float
    nominal_hz: float


def estimate(
    level: np.ndarray, time_s: FloatArray, axis: str, nominal_hz: float | None
) -> Estimates:
    """Run the ENF tracker and the idle estimator on row means.

    Parameters
    ----------
    level : ndarray (frames, lines, strips)
        8-bit levels.
    time_s : ndarray (frames,)
        Start of each frame.
    axis : str
        ``rows`` or ``columns``.
    nominal_hz : float or None
        50 or 60; None finds it from the data.
    """
    enf = enf_of(level, time_s, axis, TrackSettings(nominal_hz=nominal_hz))
    idle = make_idle(IdleSettings(nominal_hz=nominal_hz))
    found = [e for block in _blocks(level, time_s, axis) for e in idle.update(block)] + idle.flush()
    seen = nominal_hz or next((e.nominal_hz for e in enf if e.usable), 50.0)
    return Estimates(enf, found[-1].idle_ratio if found else float("nan"), seen)


def enf_of(
    level: np.ndarray, time_s: FloatArray, axis: str, settings: TrackSettings
) -> tuple[EnfEstimate, ...]:
    """Track the ENF of row means.

    Parameters
    ----------
    level : ndarray (frames, lines, strips)
        8-bit levels; one line and strip for frame means.
    time_s : ndarray (frames,)
        Start of each frame.
    axis : str
        ``rows``, ``columns`` or ``frame``.
    settings : TrackSettings
    """
    tracker = make_tracker(settings)
    blocks = _blocks(level, time_s, axis)
    estimates = [e for block in blocks for e in tracker.update(block)] + tracker.flush()
    return tuple(e for e in estimates if e.rank == 0)  # the tracker's answer, no alternatives


def _blocks(level: np.ndarray, time_s: FloatArray, axis: str) -> Iterator[RowBlock]:
    lines = averaged(level, group_of(level.shape[1], MOST_LINES))
    return blocks_from_luminance(lines, time_s, Header(), read_out_axis=axis)
