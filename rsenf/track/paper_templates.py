"""The paper's hypotheses, and the spectrum of the interpolated series at the lines of all of them.

A hypothesis is a line with an idle ratio, from which follow the ``M − L`` rows missing between two
frames of ``L`` rows. Every interpolation here is linear in the rows of the frames on either side,
and the same for all frames: it needs only a few features of each frame. The series' Fourier sum at
``f_y`` is taken frame by frame: within a frame period a sum against a phase ramp of ``f_y/F_r``
turns, and from frame to frame a rotation that all lines of a harmonic share, since they are a whole
number of ``F_r`` apart. The rows of a frame enter by one matrix product; the interpolated ones by a
product with the features. No series is made, and no long Fourier transform.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line
from rsenf.messages import RowBlock

IDLE_RATIOS = tuple(percent / 100.0 for percent in range(0, 100, 5))
# Frame rates (at 50 Hz) for which the paper lists its lines, without folded ones.
PUBLISHED_RATES_HZ = (25.0, 30000 / 1001, 30.0)
SAME_RATE_HZ = 0.01


@dataclass(frozen=True)
class Hypothesis:
    """A spectral line of the rows, concatenated under an assumed idle ratio.

    Parameters
    ----------
    line : Line
    idle_ratio : float
    """

    line: Line
    idle_ratio: float

    def period_rows(self, rows: int) -> int:
        """Rows that fit into a frame period, ``M = L/(1 − ρ)``, rounded to a whole row."""
        return round(rows / (1.0 - self.idle_ratio))


def hypotheses(nominal_hz: float, frame_rate_hz: float, search_hz: float) -> tuple[Hypothesis, ...]:
    """List every line with every idle ratio of 0, 5, … 95 %, line by line.

    Parameters
    ----------
    nominal_hz : float
        Nominal grid frequency.
    frame_rate_hz : float
    search_hz : float
        Half-width of the search band around a line.
    """
    lines = paper_lines(nominal_hz, frame_rate_hz, search_hz)
    return tuple(Hypothesis(line, idle) for line in lines for idle in IDLE_RATIOS)


def paper_lines(nominal_hz: float, frame_rate_hz: float, search_hz: float) -> tuple[Line, ...]:
    """Lines of the paper's Section V, in the order of their frequency.

    They are ``|f_0 + m·F_r| ≤ 2·f_0`` and the second harmonic ``2·f_0``. At 25, 29.97 and 30
    frames/s of a 50 Hz grid the paper lists 25, 50 … 200 Hz and 10, 40 … 190, 200 Hz, without lines
    folded at 0 Hz, which its bound on ``m`` (Eq. 20) excludes; so they are left out at these rates.
    Of lines within one search band only the first is kept, as all would find the same peak; and
    none within a search band of 0 Hz, where it would overlap its own mirror image.

    Parameters
    ----------
    nominal_hz, frame_rate_hz : float
    search_hz : float
        Half-width of the search band around a line.

    Examples
    --------
    >>> [round(line.line_hz(30.0)) for line in paper_lines(50.0, 30.0, 0.5)]
    [10, 40, 70, 100, 130, 160, 190, 200]
    """
    f0_hz = 2.0 * nominal_hz
    reach = int(3.0 * f0_hz / frame_rate_hz) + 1
    comb = [Line(nominal_hz, 1, m) for m in range(-reach, reach + 1)]
    comb.sort(key=lambda line: (line.line_hz(frame_rate_hz) < 0.0, abs(line.m), line.m))
    found: list[Line] = []
    for line in (Line(nominal_hz, 2, 0), *comb):
        place_hz = line.line_hz(frame_rate_hz)
        folded = place_hz < 0.0 and _is_published(nominal_hz, frame_rate_hz)
        outside = not search_hz < abs(place_hz) <= 2.0 * f0_hz
        taken = (abs(x.line_hz(frame_rate_hz)) for x in found)
        if not (folded or outside or any(abs(abs(place_hz) - t) < search_hz for t in taken)):
            found.append(line)
    return tuple(sorted(found, key=lambda line: abs(line.line_hz(frame_rate_hz))))


def _is_published(nominal_hz: float, frame_rate_hz: float) -> bool:
    near = any(abs(frame_rate_hz - rate) < SAME_RATE_HZ for rate in PUBLISHED_RATES_HZ)
    return nominal_hz == 50.0 and near


Float = NDArray[np.float64]

# Rows averaged at a frame's edge for the ends of a straight line: a single one is noisy.
EDGE_RATIO = 0.02


@dataclass(frozen=True, eq=False)
class Fill:
    """Linear map from two frames to the rows missing between them.

    With ``f = features.T @ rows`` of the frame before and of the frame after, the missing rows
    are ``before @ f_before + after @ f_after``.

    Parameters
    ----------
    features : ndarray, shape (rows, k)
        Weights of a frame's rows.
    before, after : ndarray, shape (gap, k)
        Weights of the two frames' features for each missing row, in the order of time.
    """

    features: Float
    before: Float
    after: Float


def neighbour_mean(rows: int, gap: int, turns: float) -> Fill:
    """Mean of all rows of both frames (paper, Section V): the same for every missing row.

    Parameters
    ----------
    rows, gap : int
        Rows of a frame, and missing rows.
    turns : float
        Turns of the flicker's phase from row to row.
    """
    half = np.full((gap, 1), 0.5)
    return Fill(np.full((rows, 1), 1.0 / rows), half, half)


def neighbour_rows(rows: int, gap: int, turns: float) -> Fill:
    """Mean of the same row of both frames, from the first down, and again from the first.

    Another reading of the paper's "averaging the samples of the previous and of the next frame".
    """
    half = 0.5 * np.eye(rows)[np.arange(gap) % rows]
    return Fill(np.eye(rows), half, half)


def linear(rows: int, gap: int, turns: float) -> Fill:
    """Straight line in time from the last rows of one frame to the first rows of the next.

    Examples
    --------
    >>> fill = linear(4, 3, 0.0)
    >>> frame = fill.features.T @ np.array([1.0, 2.0, 3.0, 5.0])
    >>> (fill.before @ frame + fill.after @ frame).tolist()
    [4.0, 3.0, 2.0]
    """
    edge = max(round(EDGE_RATIO * rows), 1)
    features = np.zeros((rows, 2))
    features[:edge, 0] = features[rows - edge :, 1] = 1.0 / edge
    share = (np.arange(gap) + 1.0) / (gap + 1.0)
    nothing = np.zeros(gap)
    return Fill(
        features, np.stack([nothing, 1.0 - share], axis=1), np.stack([share, nothing], axis=1)
    )


def harmonic(rows: int, gap: int, turns: float) -> Fill:
    """A constant and a sine at ``f_0``, fitted to all rows of both frames by least squares."""
    basis = _sine(np.arange(rows), turns)
    # The frame before began rows + gap earlier: its sine is the same one, rotated.
    turned = _sine(np.arange(rows) - (rows + gap), turns)
    turn = np.linalg.lstsq(basis, turned, rcond=None)[0]
    inverse = np.linalg.pinv(basis.T @ basis + turned.T @ turned, hermitian=True)
    missing = _sine(np.arange(-gap, 0), turns)
    return Fill(basis, missing @ inverse @ turn.T, missing @ inverse)


def _sine(place: NDArray[np.int64], turns: float) -> Float:
    """Constant, cosine and sine at places along the rows, shape (places, 3)."""
    angle = 2.0 * np.pi * turns * place
    return np.stack([np.ones(place.size), np.cos(angle), np.sin(angle)], axis=1)


def none(rows: int, gap: int, turns: float) -> Fill:
    """No interpolation: missing rows are 0, and the ramp down the rows is a matched filter."""
    return Fill(np.zeros((rows, 0)), np.zeros((gap, 0)), np.zeros((gap, 0)))


# Functions of (rows of a frame, missing rows, turns of the flicker from row to row), by name.
INTERPOLATIONS: dict[str, Callable[[int, int, float], Fill]] = {
    "neighbour_mean": neighbour_mean,
    "neighbour_rows": neighbour_rows,
    "linear": linear,
    "harmonic": harmonic,
    "none": none,
}


Complex = NDArray[np.complex128]


class PaperTemplates:
    """Reduces row blocks, one after the other, to slow-time values of all hypotheses.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
    frame_rate_hz : float
    rows : int
        Rows of a frame.
    interpolation : str
        Name in :data:`rsenf.track.paper_templates.INTERPOLATIONS`.
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
