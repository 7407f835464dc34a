"""Spectrum of the interpolated series at all hypotheses' lines, one complex number a frame each.

The series has ``M`` samples a frame: its ``L`` rows and ``M − L`` interpolated ones. Its Fourier
sum at ``f_y`` is taken frame by frame: within a frame period a sum against a phase ramp of
``f_y/F_r`` turns, and from frame to frame a rotation that all lines of a harmonic share, since they
are a whole number of ``F_r`` apart. The rows of a frame enter by one matrix product; the
interpolated ones are linear in a few features of the frames on either side, so they enter by a
product with those. No series is made, and no long Fourier transform.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock
from rsenf.track.interpolate import INTERPOLATIONS
from rsenf.track.paper_hypotheses import Hypothesis

Complex = NDArray[np.complex128]
Float = NDArray[np.float64]


class PaperTemplates:
    """Reduces row blocks, one after the other, to slow-time values of all hypotheses.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
    frame_rate_hz : float
    rows : int
        Rows of a frame.
    interpolation : str
        Name in :data:`rsenf.track.interpolate.INTERPOLATIONS`.
    """

    def __init__(
        self, hypotheses: Sequence[Hypothesis], frame_rate_hz: float, rows: int, interpolation: str
    ) -> None:
        self._ramps = np.empty((rows, len(hypotheses)), np.complex128)
        # Feature matrices; several idle ratios often share one.
        blocks: list[Float] = [np.zeros((rows, 0))]
        parts: list[tuple[slice, list[int], Complex, Complex]] = []
        groups: dict[tuple[float, float], list[int]] = {}
        for i, one in enumerate(hypotheses):
            groups.setdefault((one.line.nominal_hz, one.idle_ratio), []).append(i)
        for (nominal_hz, _), members in groups.items():
            period = hypotheses[members[0]].period_rows(rows)
            fill = INTERPOLATIONS[interpolation](
                rows, period - rows, 2.0 * nominal_hz / frame_rate_hz / period
            )
            turns = np.array([hypotheses[i].line.turns(frame_rate_hz) for i in members]) / period
            self._ramps[:, members] = _ramps(np.arange(rows), turns) / rows
            # A frame's value covers the gap before it, then its rows.
            missing = _ramps(np.arange(rows - period, 0), turns) / rows
            at = _place(blocks, fill.features)
            parts.append((at, members, fill.before.T @ missing, fill.after.T @ missing))
        self._features = np.concatenate(blocks, axis=1)
        self._before, self._after = (
            np.zeros((self._features.shape[1], len(hypotheses)), np.complex128) for _ in range(2)
        )
        for at, members, before, after in parts:
            self._before[at, members] = before
            self._after[at, members] = after
        self._last: tuple[int, Float] | None = None

    def reduce(self, block: RowBlock) -> Complex:
        """Slow-time value of every frame and hypothesis, shape (frames, hypotheses).

        Strips are averaged. Next to a missing frame the idle period stays empty.
        """
        profile = block.profiles()
        # A real matrix times real and imaginary parts: half the work of a complex product.
        value = np.asarray(profile @ self._ramps.view(np.float64)).view(np.complex128)
        features = profile @ self._features
        number, before = self._last or (-2, np.zeros(features.shape[1]))
        self._last = int(block.frame_number[-1]), features[-1]
        follows = np.diff(block.frame_number, prepend=number) == 1
        before_each = np.concatenate([before[None], features[:-1]])
        filled = features @ self._after + before_each @ self._before
        return np.asarray(value + follows[:, None] * filled, np.complex128)


def _ramps(place: NDArray[np.int64], turns: Float) -> Complex:
    """Conjugated phase ramps, shape (places, lines), with ``turns`` from place to place."""
    return np.asarray(np.exp(-2j * np.pi * place[:, None] * turns), np.complex128)


def _place(blocks: list[Float], features: Float) -> slice:
    """Columns of features among those of all fills; new ones are appended."""
    start = 0
    for known in blocks:
        if np.array_equal(known, features):
            break
        start += known.shape[1]
    else:
        blocks.append(features)
    return slice(start, start + features.shape[1])
