"""The measured data: row means with frame times, in training and held-out blocks of time.

The noise of a sensor is independent in each row. A codec quantises blocks of eight and more rows
together and removes fine detail, so that rows of one block share noise. So the axis along which
neighbours have independent noise, rows or strips, is found by a test: the difference of two strips
of a row, each relative to its mean, contains neither flicker nor the camera's gain, and its third
difference down the rows nothing smooth. For white noise the correlation of neighbouring third
differences is exactly −3/4; any other value means shared noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.discrepancy.lines import (
    Estimates,
    along_rows,
    averaged,
    enough,
    estimate,
    fields_of,
    group_of,
    texture_of,
)
from rsenf.discrepancy.settings import BLOCK_S, FEWEST_BLOCKS, FEWEST_LINES, SHORTEST_S
from rsenf.errors import InputError, NoSignal
from rsenf.messages import RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.timebase import NS_PER_S

LINES, STRIPS = 1, 2  # axes of (frames, lines, strips)
TIMES = 3  # order of the differences
WHITE = -TIMES / (TIMES + 1.0)  # correlation of neighbouring differences of white noise
STDS = 5.0
AnyArray = NDArray[Any]
Float32Array = NDArray[np.float32]
Mask = NDArray[np.bool_]
Part = tuple[slice, ...]  # index into an array (frames, lines, strips)
ALL: Part = (slice(None),)
BANDS = 8  # of lines
# Usual frame rates; a measured one within SAME_RATE (relative) is taken for the usual one.
RATES = (
    *(Fraction(n) for n in (24, 25, 30, 48, 50, 60, 100, 120, 240)),
    *(Fraction(n * 1000, 1001) for n in (24, 30, 60, 120, 240)),
)
SAME_RATE = 5e-4
APART_FRAMES = 600  # used to find the axis of independent noise
MOST_SLIP = 0.25  # frames by which the usual rate may be off over the whole recording


def apart_of(level: NDArray[np.float32]) -> int:
    """Return the axis: ``LINES``, or ``STRIPS`` where rows share noise.

    Parameters
    ----------
    level : ndarray (frames, lines, strips)
        With one strip only the test isn't possible, and the axis is ``LINES``.
    """
    if level.shape[STRIPS] < 2:
        return LINES
    relative = level / np.maximum(level.mean(axis=0), 1e-6)
    pairs = level.shape[STRIPS] // 2
    difference = relative[:, :, 0 : 2 * pairs : 2] - relative[:, :, 1 : 2 * pairs : 2]
    # What differs between interlaced fields isn't noise; a codec's is shared within a field, too.
    return STRIPS if _is_shared(difference) and _is_shared(difference[:, ::2]) else LINES


def _is_shared(difference: NDArray[np.float32]) -> bool:
    """Whether the noise of neighbouring rows is correlated, positively or negatively."""
    steps = np.diff(difference, TIMES, axis=LINES)
    steps -= steps.mean(axis=0)
    power = float((steps * steps).mean(dtype=np.float64))
    if power == 0.0:
        return False
    shared = float((steps[:, 1:] * steps[:, :-1]).mean(dtype=np.float64)) / power - WHITE
    return bool(abs(shared) * steps.size**0.5 > STDS)


@dataclass(frozen=True, eq=False)
class Measured:
    """Row means of one recording."""

    # (frames, lines, strips) 8-bit levels, lines in the order of their places in the picture
    level: Float32Array
    stamp_s: FloatArray  # (frames,) time stamp of each frame, from the first
    # (frames,) position of each frame on the clip's time axis, in frame periods
    slot: NDArray[np.int64]
    frame_rate: Fraction
    estimates: Estimates  # ENF and idle period, as rsenf's estimators find them
    axis: str = "rows"  # ``rows`` or ``columns``: what a line is
    # axis along which neighbours have independent noise: ``LINES`` for a sensor's, ``STRIPS`` after
    # a codec
    apart: int = LINES
    # (rows, strips) mean level of each row of the recording relative to its line. Rows are divided
    # by it before they are averaged, so that bright ones don't shift the effective time of their
    # line
    texture: Float32Array = field(default_factory=lambda: np.empty((0, 0), np.float32))
    fields: int = 1  # 2 if frames and lines are interlaced, else 1

    @property
    def rows(self) -> int:
        """Rows in a frame of the recording."""
        return max(len(self.texture), self.lines)

    @property
    def group(self) -> int:
        """Rows of the recording averaged into each line."""
        return self.rows // self.lines

    @property
    def nominal_hz(self) -> float:
        """Nominal frequency of the grid, 50 or 60."""
        return self.estimates.nominal_hz

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.level.shape[0])

    @property
    def lines(self) -> int:
        """Lines in a frame."""
        return int(self.level.shape[1])

    @property
    def strips(self) -> int:
        """Strips in a line."""
        return int(self.level.shape[2])

    @property
    def time_s(self) -> FloatArray:
        """Start of each frame, taken as equidistant."""
        return np.asarray(self.slot / float(self.frame_rate))

    @property
    def block(self) -> NDArray[np.int64]:
        """Block number of each frame, (frames,); there are at least ``FEWEST_BLOCKS``."""
        duration_s = float(self.time_s[-1]) + 1.0 / float(self.frame_rate)
        block_s = min(BLOCK_S, duration_s / FEWEST_BLOCKS)
        return np.asarray(self.time_s // block_s, np.int64)

    @property
    def training(self) -> Mask:
        """Frames of the even blocks, which models are fitted to; the others are held out."""
        return np.asarray(self.block % 2 == 0)

    @property
    def coded(self) -> bool:
        """Whether rows have correlated noise, as after a codec."""
        return self.apart == STRIPS

    @property
    def first(self) -> Part:
        """Index of the half that latent series are estimated from: every other line or strip."""
        return (slice(None),) * self.apart + (slice(0, None, 2),)

    @property
    def second(self) -> Part:
        """Index of their neighbours, which judge the fit."""
        return (slice(None),) * self.apart + (slice(1, None, 2),)

    def halves(self, array: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Split an array (frames, lines, strips) into both halves, in pairs of neighbours."""
        second = array[self.second]
        pairs = (slice(None),) * self.apart + (slice(second.shape[self.apart]),)
        return array[self.first][pairs], second

    def as_recorded(self, level: Float32Array) -> Float32Array:
        """Expand lines to the recording's rows, texture included, (frames, rows, strips)."""
        return along_rows(level, self.group, self.rows, fields=self.fields) * self.texture

    def as_lines(self, level: Float32Array) -> Float32Array:
        """Average rows of the recording into lines, texture removed, (frames, lines, strips)."""
        return averaged(level / self.texture, self.group, self.fields)

    def until(self, end_s: float) -> Measured:
        """Return its frames before a time."""
        n = int(np.searchsorted(self.time_s, end_s))
        return dataclasses.replace(
            self, level=self.level[:n], stamp_s=self.stamp_s[:n], slot=self.slot[:n]
        )

    def every(self, axis: int) -> int:
        """Lines or strips from one pair of neighbours to the next along an axis."""
        return 2 if axis == self.apart else 1


def measured_of(blocks: Sequence[RowBlock], nominal_hz: float | None = None) -> Measured:
    """Prepare the row blocks of a recording for the workflow.

    Parameters
    ----------
    blocks : sequence of RowBlock
        Of one epoch, in order.
    nominal_hz : float, optional
        50 or 60; by default found from the data.

    Raises
    ------
    InputError
        When the recording is too short, has too few lines, or doesn't change.
    """
    level, stamp_s = joined_rows(blocks)
    if blocks[0].read_out_axis == "frame":
        problem = "one mean for the whole frame: it is rows that are compared"
        raise InputError(problem, "give the video, an .npz with 'rows', or a --reference")
    if level.shape[1] < FEWEST_LINES:
        raise InputError(f"{level.shape[1]} lines a frame", f"at least {FEWEST_LINES} are needed")
    if stamp_s[-1] < SHORTEST_S:
        raise InputError(
            f"{stamp_s[-1]:.1f} s are too short to fit a model and to score it",
            f"{SHORTEST_S:.0f} s are the least that is of use",
        )
    if np.ptp(level, axis=0).max() == 0.0:
        raise NoSignal("every frame is the same", "give a recording of mains light")
    rate = frame_rate_of(stamp_s)
    slot = np.rint(stamp_s * float(rate)).astype(np.int64)
    axis = blocks[0].read_out_axis
    # Frame numbers times the period: jitter of the stamps would add to the phase.
    seen = estimate(level, slot / float(rate), axis, nominal_hz)
    apart = apart_of(level[:APART_FRAMES])
    fields = fields_of(level)
    group = group_of(level.shape[1] // fields, enough(level) // fields)
    texture = texture_of(level.mean(axis=0), group, fields)
    level = averaged(level / texture, group, fields)
    return Measured(level, stamp_s, slot, rate, seen, axis, apart, texture, fields)


def joined_rows(blocks: Sequence[RowBlock]) -> tuple[Float32Array, FloatArray]:
    """Return levels (frames, lines, strips) and time stamps (s), from the first frame.

    Raises
    ------
    InputError
        When there is no frame, or a level isn't finite.
    """
    if not blocks:
        raise InputError("no frame can be read", "give a recording of mains light")
    level = np.concatenate([block.level for block in blocks])
    stamps = np.concatenate([block.frame_pts_ns for block in blocks])
    if not np.isfinite(level).all():
        raise InputError(
            "luminance that isn't finite", "repair the recording, or cut that part out"
        )
    return level, np.asarray((stamps - stamps[0]) / NS_PER_S)


def frame_rate_of(stamp_s: FloatArray) -> Fraction:
    """Frame rate of time stamps, which may have gaps and jitter.

    Examples
    --------
    >>> frame_rate_of(np.array([0.0, 0.0401, 0.08, 0.16]))
    Fraction(25, 1)
    """
    period_s, lag = float(np.median(np.diff(stamp_s))), 1
    while lag < stamp_s.size:  # over ever longer times, of which jitter is an ever smaller share
        apart_s = stamp_s[lag:] - stamp_s[:-lag]
        period_s = float(np.median(apart_s / np.maximum(np.rint(apart_s / period_s), 1.0)))
        lag *= 2
    rate_hz = 1.0 / period_s
    nearest = min(RATES, key=lambda rate: abs(rate_hz / float(rate) - 1.0))
    slip = abs(rate_hz / float(nearest) - 1.0)
    if slip < SAME_RATE and slip * stamp_s.size < MOST_SLIP:
        return nearest
    return Fraction(rate_hz).limit_denominator(1001)
