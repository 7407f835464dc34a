"""Stamped values to one uniform axis: nothing interpolated, every irregularity counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rsenf.errors import ReferenceFormatError
from rsenf.messages.schema import FloatArray, Int64Array, UInt32Array
from rsenf.timebase import NS_PER_S, nanoseconds

AGREE_HZ = 0.005  # duplicates further apart contradict each other
OFF_GRID_RATIO = 0.02  # of the step: smaller deviations of a time stamp aren't worth a note
MAX_SAMPLES = 200_000_000
MAX_GAP_RATIO = 1000  # samples per value: beyond it a date is wrong, not missing
_USUAL_STEPS_S = (0.02, 0.04, 0.05, 0.1, 0.2, 0.25, 0.5, 1, 2, 3, 4, 5, 6, 10, 12, 15, 20, 30, 60)


@dataclass(frozen=True, eq=False)
class Axis:
    """Values on a uniform axis that starts at ``t0_ns``."""

    t0_ns: int
    step_s: float
    freq_hz: FloatArray
    readings: UInt32Array
    notes: list[str]


def to_axis(t_ns: Int64Array, freq_hz: FloatArray, step_s: float | None, where: str) -> Axis:
    """Sort stamped values onto a uniform axis.

    Parameters
    ----------
    t_ns : ndarray of int64, shape (n,)
    freq_hz : ndarray of float, shape (n,)
        NaN for no reading.
    step_s : float, optional
        Time between samples; the usual distance of the stamps when not given.
    where : str
        Name of the file, for error messages.

    Raises
    ------
    ReferenceFormatError
        When no step can be told, or the stamps span more than any recording does.
    """
    notes = []
    if np.any(np.diff(t_ns) < 0):
        notes.append("rows not in the order of time: sorted")
        order = np.argsort(t_ns, kind="stable")
        t_ns, freq_hz = t_ns[order], freq_hz[order]
    step_ns = nanoseconds(step_s) if step_s is not None else _usual_step_ns(t_ns, where)
    index, t0_ns, off_ns = _nearest_samples(t_ns, step_ns)
    total = int(index[-1]) + 1
    if total > MAX_SAMPLES or total > MAX_GAP_RATIO * max(t_ns.size, 1000):
        raise ReferenceFormatError(
            f"{where}: {t_ns.size} values span {total * step_ns / NS_PER_S / 86400:.0f} days",
            "look for a wrong date",
        )
    off = np.abs(off_ns) > OFF_GRID_RATIO * step_ns
    if off.any():
        notes.append(
            f"time stamps off the {step_ns / NS_PER_S:g} s grid by up to "
            f"{np.abs(off_ns).max() / NS_PER_S:.3g} s, taken for the nearest sample: {off.sum()}"
        )
    freq, readings, more = _merge(index, freq_hz, total)
    return Axis(int(t0_ns), step_ns / NS_PER_S, freq, readings, notes + more)


def _usual_step_ns(t_ns: Int64Array, where: str) -> int:
    steps = np.diff(t_ns)
    steps = steps[steps > 0]
    if not steps.size:
        raise ReferenceFormatError(
            f"{where}: all values have the same time", "give the time between them with --step-s"
        )
    step_s = float(np.median(steps)) / NS_PER_S
    near = min(_USUAL_STEPS_S, key=lambda usual: abs(usual - step_s))
    return nanoseconds(near if abs(near - step_s) < 0.02 * near else round(step_s, 3)) or 1


def _nearest_samples(t_ns: Int64Array, step_ns: int) -> tuple[Int64Array, int, Int64Array]:
    """Return each stamp's sample, the axis' start, and each stamp's distance from its sample.

    The start is the first stamp, moved by the median distance, should that one be off the grid
    that the others are on.
    """
    t0_ns = int(t_ns[0])
    for _ in range(2):
        index = (t_ns - t0_ns + step_ns // 2) // step_ns
        off_ns = t_ns - t0_ns - index * step_ns
        shift = int(np.median(off_ns))
        if abs(shift) <= OFF_GRID_RATIO * step_ns:
            break
        t0_ns += shift
    t0_ns += int(index[0]) * step_ns
    return index - index[0], t0_ns, off_ns


def _merge(
    index: Int64Array, freq_hz: FloatArray, total: int
) -> tuple[FloatArray, UInt32Array, list[str]]:
    """Average the readings of each sample where they agree."""
    ok = np.isfinite(freq_hz)
    index, values = index[ok], freq_hz[ok]
    freq, readings = np.full(total, np.nan), np.zeros(total, np.uint32)
    starts = np.flatnonzero(np.diff(index, prepend=-1))
    if not starts.size:
        return freq, readings, []
    sample, count = index[starts], np.diff(starts, append=index.size)
    spread = np.maximum.reduceat(values, starts) - np.minimum.reduceat(values, starts)
    mean = np.where(count > 1, np.add.reduceat(values, starts) / count, values[starts])
    freq[sample] = np.where(spread <= AGREE_HZ, mean, np.nan)
    readings[sample] = count
    notes = []
    if np.any(count > 1):
        notes.append(f"samples with more than one reading, averaged: {(count > 1).sum()}")
    if np.any(spread > AGREE_HZ):
        notes.append(
            f"samples whose readings disagree by more than {AGREE_HZ * 1e3:g} mHz, "
            f"taken as gaps: {(spread > AGREE_HZ).sum()}"
        )
    return freq, readings, notes
