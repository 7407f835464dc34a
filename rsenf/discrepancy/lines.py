"""Averages the rows of a recording into lines, and estimates initial values for a fit of them.

The cost of a fit is proportional to the number of lines, its information isn't: the flicker has
some ten periods down a frame, and noise averages in the same way before a fit or in it. The initial
values are ENF and idle period of the rows, as rsenf's estimators find them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.idle import IdleSettings, make_idle
from rsenf.messages import EnfEstimate, Header, RowBlock
from rsenf.messages.schema import Float32Array, FloatArray
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

ENOUGH, FEWEST, FRAMES = 120, 60, 2400  # lines; frames up to which there are ENOUGH
MOST, FAST = 240, 2.0  # lines for fast tones; power of a tone over the median of the upper band
BLACK = 1e-6  # level of lines that have no texture: black bars
DARK = 0.25  # least level of a row relative to its line, when divided by it
# Interlace test: frames used, standard errors, least relative power, odd over even lags.
FIELD_FRAMES, FIELD_STDS, FIELD_RATIO, FIELD_ALIKE = 200, 6.0, 1e-3, 0.25
MOST_LINES = 240  # lines of a frame that the estimators get


def enough(level: Float32Array) -> int:
    """How many lines are needed for rows (frames, rows, strips).

    Fewer for a long recording, to limit memory; more where light varies so fast down the rows that
    it would alias in few lines.
    """
    lines = min(max(ENOUGH * FRAMES // len(level), FEWEST), ENOUGH)
    seen = level[:: max(len(level) // FIELD_FRAMES, 1)].mean(axis=2)
    seen = seen / np.maximum(seen.mean(axis=0), 1.0) - 1.0  # relative light, without texture
    seen *= np.hanning(seen.shape[1]).astype(np.float32)
    power = (np.abs(np.fft.rfft(seen, axis=1)) ** 2).mean(axis=0)
    noise = float(np.median(power[power.size // 2 :]))
    # A tone needs at least 2.5 lines a period.
    while lines < MOST and power[2 * lines // 5 : MOST // 2].max(initial=0.0) > FAST * noise:
        lines *= 2
    return min(lines, MOST)


def group_of(rows: int, most: int) -> int:
    """How many neighbouring rows to average into one line.

    All lines average equally many rows, as they must be equidistant in time; a few rows at the end
    may be left over.

    Parameters
    ----------
    rows : int
    most : int
        Largest number of lines.

    Examples
    --------
    >>> group_of(1080, 240), group_of(100, 240)
    (5, 1)
    """
    group = -(-rows // most)
    # Fewer lines, if no row is then left over.
    return next((n for n in range(group, 2 * group) if rows % n == 0), group)


def averaged(level: Float32Array, group: int, fields: int = 1) -> Float32Array:
    """Average neighbouring rows into lines.

    Parameters
    ----------
    level : ndarray of float32 (frames, rows, strips)
    group : int
        Rows averaged into each line.
    fields : int, optional
        2 for interlaced frames, whose fields are averaged separately and interlaced again.

    Returns
    -------
    ndarray of float32 (frames, lines, strips)
    """
    if group == 1:
        return level
    span = group * fields
    end = level.shape[1] // span * span
    out = np.empty((level.shape[0], end // group, level.shape[2]), np.float32)
    for field in range(fields):
        mean = out[:, field::fields]
        mean[:] = level[:, field:end:span]
        for row in range(field + fields, span, fields):
            mean += level[:, row:end:span]
    out *= np.float32(1.0 / group)
    return out


def along_rows(
    array: NDArray[Any], group: int, rows: int, *, fields: int = 1, axis: int = 1
) -> NDArray[Any]:
    """Repeat the values of lines, along one axis, for all of their rows.

    ``group`` rows are in a line, ``rows`` in all; rows left over get the last value.
    """
    row, last = np.arange(rows), array.shape[axis] // fields - 1
    line = np.minimum(row // fields // group, last) * fields + row % fields
    return np.asarray(np.take(array, line, axis=axis))


def texture_of(row_level: Float32Array, group: int, fields: int = 1) -> Float32Array:
    """Return the mean level of each row relative to its line of ``group`` rows, (rows, strips)."""
    line = averaged(row_level[None], group, fields)[0]
    mean = along_rows(line, group, len(row_level), fields=fields, axis=0)
    ratio = np.maximum(row_level, DARK * mean) / np.maximum(mean, BLACK)
    return np.asarray(np.where(mean > BLACK, ratio, 1.0), np.float32)


def fields_of(level: Float32Array) -> int:
    """Return 2 for interlaced frames, in which neighbouring rows are from different times; else 1.

    The statistic is the autocovariance down the rows of each row's deviation from the mean of its
    neighbours, at lags 3 to 5: interlacing makes it alternate in sign. Texture is constant in time
    and subtracted, noise is uncorrelated at these lags, smooth changes have hardly any deviation,
    and a fast tone has another period.
    """
    seen = level[:: max(len(level) // FIELD_FRAMES, 1)]
    beyond = seen[:, 1:-1] - 0.5 * (seen[:, :-2] + seen[:, 2:])
    beyond -= beyond.mean(axis=0)
    odd, even, next_odd = (
        (-1.0) ** lag * (beyond[:, lag:] * beyond[:, :-lag]).mean(axis=(0, 2), dtype=np.float64)
        for lag in (3, 4, 5)
    )
    sure = even.mean() / (even.std() * np.sqrt(5.0 / even.size) + 1e-30)
    beside = FIELD_ALIKE * even.mean()
    woven = (
        sure > FIELD_STDS
        and even.mean() > FIELD_RATIO * seen.var(axis=0).mean()
        and min(odd.mean(), next_odd.mean()) > beside
    )
    return 2 if woven else 1


@dataclass(frozen=True, eq=False)
class Estimates:
    """ENF and idle period of a recording."""

    enf: tuple[EnfEstimate, ...]
    idle_ratio: float  # NaN if unknown
    nominal_hz: float  # 50 or 60


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
