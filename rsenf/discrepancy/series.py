"""Series: effects with one value for each frame or line, estimated by linear least squares.

The capture model gives the rows' response to a unit of all values at once. Values of frames are
estimated from one half of the lines (strips after a codec), values of lines from the training
frames, so that the rest of the data shows whether they are more than noise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from rsenf.discrepancy.fit_parameters import series_of, within
from rsenf.discrepancy.forward_model import ForwardModel, plan, slope_of
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.messages.schema import FloatArray
from rsenf.model import Effect
from rsenf.model.parameters import Fitting

WHITE_STDS, RARE, FAR_OUT = 4.0, 1e-4, 15.0
RAMP_SHARE = 0.95  # of the power of gains of lines: of patterns over rows, a ramp has less
SMOOTH = 0.3  # lag-1 correlation of lines above which the rows averaged in one have equal values
BEND = 1e-6  # weight of the curvature penalty, relative to the data's mean information


def with_series(
    forward: ForwardModel, effect: Effect, name: str, values: FloatArray
) -> ForwardModel:
    """Return a forward model in which an effect, new or not, has given values of its series."""
    changed = dataclasses.replace(effect, **{name: tuple(values.tolist())})
    return forward.with_model(forward.model.put(changed))


def held(
    forward: ForwardModel, data: Measured, effect: Effect, name: str, how: Fitting
) -> FloatArray:
    """Return the values of an effect's series; zeros if it has none yet."""
    count = plan(forward.model, data).start_s.size if how.each == "frame" else data.lines
    current = np.array(getattr(effect, name))
    return current if current.size else np.zeros(count)


def response(
    forward: ForwardModel,
    rows: Float32Array,
    data: Measured,
    effect: Effect,
    name: str,
    how: Fitting,
) -> Float32Array:
    """Derivative of the rows when all values of a series rise alike, (frames, lines, strips)."""
    values = held(forward, data, effect, name, how) + how.step
    moved = with_series(forward, effect, name, values).rows(data)
    return slope_of(moved, rows, how.step)


def halves(
    direction: Float32Array, residual: Float32Array, lit: Float32Array, data: Measured, how: Fitting
) -> tuple[FloatArray, FloatArray]:
    """Estimate the values of a series from either half of the data, with independent noise.

    For frames, the halves are those of :meth:`Measured.halves`. For lines they are the training and
    the held-out frames, and the component that the wall could explain is projected out.

    Parameters
    ----------
    direction : ndarray of float32 (frames, lines, strips)
        Result of :func:`response`.
    residual, lit : ndarray of float32 (frames, lines, strips)
        Residual, and derivative by a relative change of the wall.
    data : Measured
    how : Fitting
    """
    if how.each == "frame":
        first, second = (
            _along_time(direction[part], residual[part], data, how)
            for part in (data.first, data.second)
        )
        return first, second
    out = []
    for frames in (data.training, ~data.training):
        alone = _beside(direction[frames], lit[frames])
        out.append(least(alone, residual[frames], (0, 2)))
    return out[0], out[1]


def power(direction: Float32Array, lit: Float32Array, how: Fitting) -> FloatArray:
    """Sum of squares of the rows' response per unit of each value, wall projected out."""
    if how.each == "frame":
        return _squares(direction, (1, 2))
    return _squares(_beside(direction, lit), (0, 2))


def improved(
    forward: ForwardModel,
    residual: Float32Array,
    lit: Float32Array,
    responses: dict[str, Float32Array],
    data: Measured,
) -> tuple[ForwardModel, Float32Array, float]:
    """Update the series of all effects by one linear step, given their responses.

    Returns the model, the residual after the step to first order, and the largest change of a value
    in the steps of its parameter.
    """
    farthest = 0.0
    for effect in forward.model.effects:
        series = series_of(effect)
        if series is None:
            continue
        name, how = series
        found, residual = followed(responses[effect.name], residual, lit, data, how)
        values = held(forward, data, effect, name, how)
        # A duplicated frame has one value: of its two estimates the last one is kept.
        taken = plan(forward.model, data).number[data.slot]
        values[taken if how.each == "frame" else slice(None)] += found
        forward = with_series(forward, effect, name, values)
        farthest = max(farthest, float(np.abs(found).max() / how.step))
    return forward, residual, farthest


def followed(
    direction: Float32Array, residual: Float32Array, lit: Float32Array, data: Measured, how: Fitting
) -> tuple[FloatArray, Float32Array]:
    """Return the values that one half of the residual gives, and the residual without them."""
    found, _ = halves(direction, residual, lit, data, how)
    along = (slice(None), None, None) if how.each == "frame" else (None, slice(None), None)
    return found, residual - found.astype(np.float32)[along] * direction


def summed_up(
    effect: Effect, first: FloatArray, second: FloatArray, step_s: float, group: int
) -> Effect:
    """Return an effect with the rms of its series and its correlation time as parameters.

    Parameters
    ----------
    effect : Effect
    first, second : ndarray
        The series from either half of the data; noise doesn't bias their product.
    step_s : float
        Time between its values.
    group : int
        Rows averaged in a line, which reduces what is white from row to row.
    """
    series = series_of(effect)
    if series is None or not series[1].rms:
        return effect
    first, second = first - first.mean(), second - second.mean()
    square = float(first @ second) / first.size
    stays = float(first[:-1] @ second[1:]) / max(float(first @ second), 1e-30)
    # Averaging reduces the power of a series that is white from row to row.
    more = group if series[1].each == "line" and stays < SMOOTH else 1
    values = {series[1].rms: within(effect, series[1].rms, math.sqrt(max(square, 0.0) * more))}
    if series[1].memory and square > 0.0:
        beside = float(first[:-1] @ second[1:] + second[:-1] @ first[1:]) / (2 * first.size - 2)
        stays = min(max(beside / square, 1e-6), 1.0 - 1e-6)
        values[series[1].memory] = within(effect, series[1].memory, -step_s / math.log(stays))
    return dataclasses.replace(effect, **values)


def all_as_declared(effects: Sequence[Effect], directions: int, wall: FloatArray) -> bool:
    """Whether every series has the statistics that its effect declares.

    Its innovations (for a series that wanders, beyond the prediction from the value before) must be
    white, without tones and outliers: a series without such limits would fit any residual. Values
    of lines must be uncorrelated down the frame, unlike the residual of a tone curve or a codec.
    Series declared free may take any course and aren't tested; their response on lines and strips
    identifies them. But a free gain of lines that adds the same to all, or a ramp, is no pattern.

    Parameters
    ----------
    effects : sequence of Effect
    directions : int
        Of the phase course, which absorbs the slow part of a series of frames and thereby lowers
        the correlation of its neighbours.
    wall : ndarray (lines, strips)
        Levels under the mean light.
    """
    for effect in effects:
        series = series_of(effect)
        if series is None:
            continue
        values = np.array(getattr(effect, series[0]))
        if series[1].free:
            if series[1].each == "line" and _adds_a_ramp(values, wall.mean(axis=1)):
                return False
            continue
        values = values - values.mean()
        stays = float(values[:-1] @ values[1:]) / max(float(values[:-1] @ values[:-1]), 1e-30)
        taken = directions / values.size if series[1].each == "frame" else 0.0
        chance = WHITE_STDS / np.sqrt(values.size)
        if not series[1].wanders and not -chance - taken < stays < chance:
            return False
        if series[1].each == "line":
            continue
        kicks = values[1:] - (stays * values[:-1] if series[1].wanders else 0.0)
        power = np.abs(np.fft.rfft(kicks)[1:]) ** 2
        if power.max() > power.mean() * np.log(power.size / RARE):
            return False
        if np.abs(kicks).max() > FAR_OUT * 1.4826 * float(np.median(np.abs(kicks))):
            return False
    return True


def _adds_a_ramp(gains: FloatArray, level: FloatArray) -> bool:
    """Whether gains of lines are a ramp down the frame, or add one to the lines' levels."""
    ramp = np.vander(np.linspace(-1.0, 1.0, level.size), 2)
    ramps = np.hstack([ramp, ramp / np.maximum(level, 1.0)[:, None]])
    rest = gains - ramps @ np.linalg.lstsq(ramps, gains)[0]
    return float(rest @ rest) < (1.0 - RAMP_SHARE) * float(gains @ gains)


def _along_time(
    direction: Float32Array, residual: Float32Array, data: Measured, how: Fitting
) -> FloatArray:
    """Least-squares values of frames: independent ones, or a piecewise linear course."""
    if not how.every_s:
        return least(direction, residual, (1, 2))
    product = (direction * residual).sum(axis=(1, 2), dtype=np.float64)
    square = _squares(direction, (1, 2))
    hats = between_nodes(data.time_s, how.every_s)
    matrix = hats.T @ (square[:, None] * hats)
    # Without frames, the course is continued linearly.
    bends = np.diff(np.eye(hats.shape[1]), 2, axis=0)
    matrix += BEND * np.trace(matrix) / len(matrix) * (bends.T @ bends)
    values = hats @ np.linalg.solve(matrix + 1e-12 * np.eye(len(matrix)), hats.T @ product)
    return np.asarray(values - values.mean())


def between_nodes(t_s: FloatArray, every_s: float) -> FloatArray:
    """Weights of equidistant nodes, at most ``every_s`` apart, in a piecewise linear course.

    >>> between_nodes(np.array([0.0, 1.0, 4.0]), 2.0).tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]
    """
    nodes = max(math.ceil(float(t_s[-1]) / every_s), 2) + 1
    place = t_s / float(t_s[-1]) * (nodes - 1)
    return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(nodes)), 0.0))


def least(direction: Float32Array, residual: Float32Array, axes: tuple[int, ...]) -> FloatArray:
    """Least-squares size of a direction in a residual, summed over some axes."""
    product = (direction * residual).sum(axis=axes, dtype=np.float64)
    return np.asarray(product / np.maximum(_squares(direction, axes), 1e-12))


def _squares(direction: Float32Array, axes: tuple[int, ...]) -> FloatArray:
    return np.asarray((direction * direction).sum(axis=axes, dtype=np.float64))


def best_step(a: FloatArray, b: FloatArray, edge: int = 0) -> tuple[float, int]:
    """What the best single step explains of the product of two centred series, and its index.

    Not one within ``edge`` values of an end.
    """
    before = np.arange(1, a.size)
    explained = np.cumsum(a)[:-1] * np.cumsum(b)[:-1] * a.size / (before * (a.size - before))
    at = int(np.argmax(explained[edge : explained.size - edge])) + edge
    return float(explained[at]), at + 1


def _beside(direction: Float32Array, lit: Float32Array) -> Float32Array:
    """Project out of a direction, line by line, what a change of the wall does."""
    same = (direction * lit).sum(axis=0) / np.maximum((lit * lit).sum(axis=0), 1e-12)
    return np.asarray(direction - same * lit)
