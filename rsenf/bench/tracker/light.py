"""Rows of a wall in a lamp's light, generated block by block in constant memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import Header, ReferenceBlock, RowBlock
from rsenf.messages.schema import FloatArray
from rsenf.model.seeds import generator
from rsenf.rows.luminance import blocks_from_luminance
from rsenf.timebase import nanoseconds

NOMINAL_HZ, AWAY_HZ, PERIOD_S = 50.0, 0.02, 300.0
LEVEL, TEXTURE, FLICKER, NOISE = 110.0, 0.08, 0.08, 0.05
SECOND, THIRD = 0.2, 0.05  # harmonics, relative to the first
READ_OUT_RATIO, STRIPS, BLOCK_FRAMES = 0.75, 2, 8
T0_NS = 1_767_225_600 * 10**9
LATE_S = 0.2  # of a block, after its last frame


class Light:
    """Row blocks of a lamp on a grid whose frequency varies sinusoidally.

    Parameters
    ----------
    rows : int
    frame_rate_hz : float
    seed : int
        Of texture and noise.
    """

    def __init__(self, rows: int, frame_rate_hz: float, seed: int) -> None:
        self._rows, self._rate_hz = rows, frame_rate_hz
        self._rng = generator(seed, "tracker bench")
        self._wall = LEVEL * (1 + TEXTURE * self._rng.standard_normal((rows, STRIPS)))
        self._line_s = READ_OUT_RATIO / frame_rate_hz * np.arange(rows) / rows

    def blocks(self, start_s: float, length_s: float) -> Iterator[RowBlock]:
        """Yield the row blocks of an interval; the next call may continue at its end."""
        first, end = (
            round(t * self._rate_hz / BLOCK_FRAMES) for t in (start_s, start_s + length_s)
        )
        for seq in range(first, end):
            yield self._block(seq)

    def _block(self, seq: int) -> RowBlock:
        number = seq * BLOCK_FRAMES + np.arange(BLOCK_FRAMES)
        t_s = number / self._rate_hz
        angle = 4 * np.pi * cycles(t_s[:, None] + self._line_s)
        flicker = np.cos(angle) + SECOND * np.cos(2 * angle) + THIRD * np.cos(3 * angle)
        level = self._wall * (1 + FLICKER * flicker[:, :, None])
        level += NOISE * self._rng.standard_normal(level.shape)
        (block,) = blocks_from_luminance(level, t_s, Header(source="bench/tracker"))
        arrival_ns = T0_NS + nanoseconds(float(t_s[-1]) + LATE_S)
        return _numbered(block, seq, number, arrival_ns)


def _numbered(block: RowBlock, seq: int, number: NDArray[np.integer], arrival_ns: int) -> RowBlock:
    header = dataclasses.replace(
        block.header,
        seq=seq,
        frame_first=int(number[0]),
        frame_last=int(number[-1]),
        arrival_time_ns=arrival_ns,
    )
    return dataclasses.replace(block, header=header, frame_number=number.astype(np.int64))


def cycles(t_s: FloatArray) -> FloatArray:
    """Return the mains cycles since the beginning.

    Parameters
    ----------
    t_s : ndarray

    Returns
    -------
    ndarray of the same shape
    """
    turn = 2 * np.pi / PERIOD_S
    return np.asarray(NOMINAL_HZ * t_s + AWAY_HZ / turn * (1 - np.cos(turn * t_s)))


def reference(seconds: int) -> ReferenceBlock:
    """Return the grid's mean frequency in each second since the beginning."""
    freq_hz = np.diff(cycles(np.arange(seconds + 1.0)))
    return ReferenceBlock(
        header=Header(source="reference/bench", arrival_time_ns=T0_NS),
        grid="bench",
        nominal_hz=NOMINAL_HZ,
        t0_ns=T0_NS,
        step_ns=nanoseconds(1.0),
        samples=seconds,
        total=seconds,
        freq_hz=freq_hz,
        readings=np.ones(seconds, np.uint32),
    )
