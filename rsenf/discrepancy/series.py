"""Effects that have a value of their own for each frame or line, and how the values are found.

What a value does to the data is what the model says of it; it is found by least squares from one
row in two (for frames), so that the others tell whether it is more than noise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from rsenf.discrepancy.fit_parameters import series_of, within
from rsenf.discrepancy.forward_model import ForwardModel, plan
from rsenf.discrepancy.measured import Float32Array, Measured
from rsenf.messages.schema import FloatArray
from rsenf.model import Effect
from rsenf.model.parameters import Fitting

WHITE_STDS, RARE, FAR_OUT = 4.0, 1e-4, 15.0
SMOOTH = 0.3  # correlation of lines, from which on the rows in them are alike
BEND = 1e-6  # of a course, over what the data tell of it


def with_series(
    theory: ForwardModel, effect: Effect, name: str, values: FloatArray
) -> ForwardModel:
    """Return a theory in which an effect, there or not, has such a series."""
    changed = dataclasses.replace(effect, **{name: tuple(values.tolist())})
    others = theory.model.without(effect.name)
    return theory.with_model(others.plus(changed))


def held(
    theory: ForwardModel, data: Measured, effect: Effect, name: str, how: Fitting
) -> FloatArray:
    """Return the values that an effect has: nothing yet, or what was found before."""
    count = plan(theory.model, data).start_s.size if how.each == "frame" else data.lines
    own = np.array(getattr(effect, name))
    return own if own.size else np.zeros(count)


def response(
    theory: ForwardModel,
    rows: Float32Array,
    data: Measured,
    effect: Effect,
    name: str,
    how: Fitting,
) -> Float32Array:
    """What the rows do, per unit, when every value of a series rises by the same."""
    values = held(theory, data, effect, name, how) + how.step
    moved = with_series(theory, effect, name, values).rows(data)
    return np.asarray((moved - rows) / np.float32(how.step))


def halves(
    direction: Float32Array, residual: Float32Array, lit: Float32Array, data: Measured, how: Fitting
) -> tuple[FloatArray, FloatArray]:
    """Values of a series as found on one half of the data and on the other.

    Of frames, the halves are those of the data; of lines, the training frames and the
    others, and what a brighter wall would do as well is taken off.
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
        out.append(_least(alone, residual[frames], (0, 2)))
    return out[0], out[1]


def power(direction: Float32Array, lit: Float32Array, how: Fitting) -> FloatArray:
    """Square of what each value does to the data, per unit, beside what the wall could."""
    if how.each == "frame":
        return _squares(direction, (1, 2))
    return _squares(_beside(direction, lit), (0, 2))


def improved(
    theory: ForwardModel,
    left: Float32Array,
    lit: Float32Array,
    responses: dict[str, Float32Array],
    data: Measured,
) -> tuple[ForwardModel, Float32Array, float]:
    """Move the series of all effects to where the data have them.

    Also what is left then, and how far the farthest value went, in its own steps.
    """
    farthest = 0.0
    for effect in theory.model.effects:
        told = series_of(effect)
        if told is None:
            continue
        name, how = told
        found, left = followed(responses[effect.name], left, lit, data, how)
        values = held(theory, data, effect, name, how)
        # A frame that came twice has one value: the last of its two, which are as good.
        taken = plan(theory.model, data).number[data.slot]
        values[taken if how.each == "frame" else slice(None)] += found
        theory = with_series(theory, effect, name, values)
        farthest = max(farthest, float(np.abs(found).max() / how.step))
    return theory, left, farthest


def followed(
    direction: Float32Array, left: Float32Array, lit: Float32Array, data: Measured, how: Fitting
) -> tuple[FloatArray, Float32Array]:
    """Values that a series takes by one half of what is left, and what is left then."""
    found, _ = halves(direction, left, lit, data, how)
    along = (slice(None), None, None) if how.each == "frame" else (None, slice(None), None)
    return found, left - found.astype(np.float32)[along] * direction


def summed_up(
    effect: Effect, first: FloatArray, second: FloatArray, step_s: float, group: int
) -> Effect:
    """Return an effect with its series' root mean square, and the time over which it forgets.

    Parameters
    ----------
    effect : Effect
    first, second : ndarray
        The series as found on either half of the data: their noise is not in their product.
    step_s : float
        Time between its values.
    group : int
        How many rows are averaged in a line: of what is white from row to row that takes.
    """
    told = series_of(effect)
    if told is None or not told[1].rms:
        return effect
    first, second = first - first.mean(), second - second.mean()
    square = float(first @ second) / first.size
    stays = float(first[:-1] @ second[1:]) / max(float(first @ second), 1e-30)
    # Of what is white from row to row a mean of several has less.
    more = group if told[1].each == "line" and stays < SMOOTH else 1
    values = {told[1].rms: within(effect, told[1].rms, math.sqrt(max(square, 0.0) * more))}
    if told[1].memory and square > 0.0:
        beside = float(first[:-1] @ second[1:] + second[:-1] @ first[1:]) / (2 * first.size - 2)
        stays = min(max(beside / square, 1e-6), 1.0 - 1e-6)
        values[told[1].memory] = within(effect, told[1].memory, -step_s / math.log(stays))
    return dataclasses.replace(effect, **values)


def all_as_told(effects: Sequence[Effect], directions: int) -> bool:
    """Whether every series is of the kind that its effect says: a free one would explain anything.

    Kicks, what each value brings beyond what the one before lets expect, must be white: no tone
    among them, none far out. One value a line must not go on down the frame, as what a tone curve
    or a codec makes of the wall does. ``directions`` is how many the course of the phase has, which
    takes what is slow out of a series of frames: neighbours are less alike than by chance then. One
    that may take any course is known by what it does to lines and strips alone.
    """
    for effect in effects:
        told = series_of(effect)
        if told is None or told[1].free:
            continue
        values = np.array(getattr(effect, told[0]))
        values = values - values.mean()
        stays = float(values[:-1] @ values[1:]) / max(float(values[:-1] @ values[:-1]), 1e-30)
        taken = directions / values.size if told[1].each == "frame" else 0.0
        chance = WHITE_STDS / np.sqrt(values.size)
        if not told[1].wanders and not -chance - taken < stays < chance:
            return False
        if told[1].each == "line":
            continue
        kicks = values[1:] - (stays * values[:-1] if told[1].wanders else 0.0)
        power = np.abs(np.fft.rfft(kicks)[1:]) ** 2
        if power.max() > power.mean() * np.log(power.size / RARE):
            return False
        if np.abs(kicks).max() > FAR_OUT * 1.4826 * float(np.median(np.abs(kicks))):
            return False
    return True


def _along_time(
    direction: Float32Array, residual: Float32Array, data: Measured, how: Fitting
) -> FloatArray:
    """Values of frames by least squares: each by itself, or of a course between nodes."""
    if not how.every_s:
        return _least(direction, residual, (1, 2))
    told = (direction * residual).sum(axis=(1, 2), dtype=np.float64)
    square = _squares(direction, (1, 2))
    hats = between_nodes(data.time_s, how.every_s)
    matrix = hats.T @ (square[:, None] * hats)
    # Where there are no frames, the course goes straight on.
    bends = np.diff(np.eye(hats.shape[1]), 2, axis=0)
    matrix += BEND * np.trace(matrix) / len(matrix) * (bends.T @ bends)
    values = hats @ np.linalg.solve(matrix + 1e-12 * np.eye(len(matrix)), hats.T @ told)
    return np.asarray(values - values.mean())


def between_nodes(t_s: FloatArray, every_s: float) -> FloatArray:
    """Shares that equidistant nodes have in a course at some times, (times, nodes)."""
    nodes = max(math.ceil(float(t_s[-1]) / every_s), 2) + 1
    place = t_s / float(t_s[-1]) * (nodes - 1)
    return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(nodes)), 0.0))


def _least(direction: Float32Array, residual: Float32Array, axes: tuple[int, int]) -> FloatArray:
    told = (direction * residual).sum(axis=axes, dtype=np.float64)
    return np.asarray(told / np.maximum(_squares(direction, axes), 1e-12))


def _squares(direction: Float32Array, axes: tuple[int, int]) -> FloatArray:
    return np.asarray((direction * direction).sum(axis=axes, dtype=np.float64))


def _beside(direction: Float32Array, lit: Float32Array) -> Float32Array:
    """Take off a direction, line by line, what a brighter wall does."""
    same = (direction * lit).sum(axis=0) / np.maximum((lit * lit).sum(axis=0), 1e-12)
    return np.asarray(direction - same * lit)
