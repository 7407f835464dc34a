"""What was measured, as the workflow takes it: row means with their times, in blocks of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.discrepancy.estimates import Estimates, estimate
from rsenf.discrepancy.lines import (
    along_rows,
    averaged,
    enough,
    fields_of,
    group_of,
    texture_of,
)
from rsenf.discrepancy.noise_axis import LINES, STRIPS, apart_of
from rsenf.discrepancy.settings import BLOCK_S, FEWEST_BLOCKS, FEWEST_LINES, SHORTEST_S
from rsenf.errors import InputError, NoSignal
from rsenf.messages import RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.timebase import NS_PER_S

Float32Array = NDArray[np.float32]
AnyArray = NDArray[Any]
Mask = NDArray[np.bool_]
Part = tuple[slice, ...]  # of an array (frames, lines, strips)

ALL: Part = (slice(None),)
BANDS = 8  # of lines, that are compared

# Rates that cameras have; one that is nearer to one of them than this is taken for it.
RATES = (
    *(Fraction(n) for n in (24, 25, 30, 48, 50, 60, 100, 120, 240)),
    *(Fraction(n * 1000, 1001) for n in (24, 30, 60, 120, 240)),
)
SAME_RATE = 5e-4
APART_FRAMES = 600  # in which noise is looked at for what neighbours share
MOST_SLIP = 0.25  # frames, over a whole recording


@dataclass(frozen=True, eq=False)
class Measured:
    """Row means of one recording.

    Attributes
    ----------
    level : ndarray of float32 (frames, lines, strips)
        8-bit levels, lines in the order of their places in the picture.
    stamp_s : ndarray (frames,)
        Stamp of each frame, from the first on.
    slot : ndarray of int (frames,)
        Place of each frame on the clip's time axis, in frame periods.
    frame_rate : Fraction
    estimates : Estimates
        Of its ENF and its idle period.
    axis : str
        ``rows`` or ``columns``: along which the lines lie.
    apart : int
        Axis along which neighbours have nothing to do with each other but what is systematic:
        ``LINES``, as a sensor's noise is, or ``STRIPS``, as a codec leaves it.
    texture : ndarray of float32 (rows, strips)
        Mean level of each of the recording's rows over that of its line. Rows are divided by it
        before they are averaged, or bright ones would count for more, and lines be of their time.
    fields : int
        How many are woven into each frame: then its lines are, too.
    """

    level: Float32Array
    stamp_s: FloatArray
    slot: NDArray[np.int64]
    frame_rate: Fraction
    estimates: Estimates
    axis: str = "rows"
    apart: int = LINES
    texture: Float32Array = field(default_factory=lambda: np.empty((0, 0), np.float32))
    fields: int = 1

    @property
    def rows(self) -> int:
        """How many a frame of the recording has."""
        return max(len(self.texture), self.lines)

    @property
    def group(self) -> int:
        """How many neighbouring rows of the recording are averaged into a line."""
        return self.rows // self.lines

    @property
    def nominal_hz(self) -> float:
        """Of the grid: 50 or 60."""
        return self.estimates.nominal_hz

    @property
    def frames(self) -> int:
        """How many there are."""
        return int(self.level.shape[0])

    @property
    def lines(self) -> int:
        """How many there are in a frame."""
        return int(self.level.shape[1])

    @property
    def strips(self) -> int:
        """Into how many each line is divided."""
        return int(self.level.shape[2])

    @property
    def time_s(self) -> FloatArray:
        """Start of each frame, if frames come regularly."""
        return np.asarray(self.slot / float(self.frame_rate))

    @property
    def block(self) -> NDArray[np.int64]:
        """Number of each frame's block of time, (frames,): eight blocks at least."""
        block_s = min(BLOCK_S, float(self.time_s[-1] + self.time_s[1]) / FEWEST_BLOCKS)
        return np.asarray(self.time_s // block_s, np.int64)

    @property
    def training(self) -> Mask:
        """Frames that models are fitted to; they are scored on the others."""
        return np.asarray(self.block % 2 == 0)

    @property
    def coded(self) -> bool:
        """Whether rows share their noise, as they do after a codec."""
        return self.apart == STRIPS

    @property
    def first(self) -> Part:
        """Values that what follows the noise is found from."""
        return (slice(None),) * self.apart + (slice(0, None, 2),)

    @property
    def second(self) -> Part:
        """Their neighbours, which judge it."""
        return (slice(None),) * self.apart + (slice(1, None, 2),)

    def halves(self, array: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Part an array (frames, lines, strips) into values and their neighbours, pair by pair."""
        second = array[self.second]
        pairs = (slice(None),) * self.apart + (slice(second.shape[self.apart]),)
        return array[self.first][pairs], second

    def as_recorded(self, level: Float32Array) -> Float32Array:
        """Give every row of the recording the level of its line, (frames, rows, strips)."""
        return along_rows(level, self.group, self.rows, fields=self.fields) * self.texture

    def as_lines(self, level: Float32Array) -> Float32Array:
        """Average rows of the recording into lines, (frames, lines, strips)."""
        return averaged(level / self.texture, self.group, self.fields)

    def every(self, axis: int) -> int:
        """How many lines or strips it takes to the next pair."""
        return 2 if axis == self.apart else 1


def measured_of(blocks: Sequence[RowBlock], nominal_hz: float | None = None) -> Measured:
    """Join the row blocks of a recording.

    Parameters
    ----------
    blocks : sequence of RowBlock
        Of one epoch, in order.
    nominal_hz : float, optional
        50 or 60; by default whichever is seen.

    Raises
    ------
    InputError
        When they are too short, have too few lines, or hold nothing that changes.
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
    # Stamps that jitter would move the phase: frames count.
    seen = estimate(level, slot / float(rate), axis, nominal_hz)
    apart = apart_of(level[:APART_FRAMES])
    fields = fields_of(level)
    group = group_of(level.shape[1] // fields, enough(level) // fields)
    texture = texture_of(level.mean(axis=0), group, fields)
    level = averaged(level / texture, group, fields)
    return Measured(level, stamp_s, slot, rate, seen, axis, apart, texture, fields)


def joined_rows(blocks: Sequence[RowBlock]) -> tuple[Float32Array, FloatArray]:
    """Return levels (frames, lines, strips) and stamps (s) from the first on.

    Raises
    ------
    InputError
        When there are none, or some aren't finite.
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
    """Rate that stamps, perhaps with holes and jitter, are of."""
    period_s = float(np.median(np.diff(stamp_s)))
    periods = np.maximum(np.rint(np.diff(stamp_s) / period_s), 1.0)
    rate_hz = float(periods.sum() / (stamp_s[-1] - stamp_s[0]))
    nearest = min(RATES, key=lambda rate: abs(rate_hz / float(rate) - 1.0))
    slip = abs(rate_hz / float(nearest) - 1.0)
    if slip < SAME_RATE and slip * stamp_s.size < MOST_SLIP:
        return nearest
    return Fraction(rate_hz).limit_denominator(1001)
