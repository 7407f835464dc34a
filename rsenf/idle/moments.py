"""Sums over frames that a method estimates from, in constant memory.

:class:`Moments`: a row's level is ``y[n] = Σ_k c_k·exp(j·k·ψ_n)`` for ``k`` from ``−K`` to ``K``
and noise, where ``ψ_n`` is the flicker's phase at frame ``n``, ``c_0`` the row's own level, and
``c_{−k}`` the conjugate of ``c_k``. Its least squares need ``r_k = Σ_n y[n]·exp(−j·k·ψ_n)`` and the
Gram matrix ``G_km = Σ_n exp(j·(m−k)·ψ_n)``, which is the same for all rows and depends on ``m − k``
alone. :func:`row_tones` solves them row by row, for the methods that aren't coherent. Those of one
segment of the stream after another (:class:`Segments`) show whether the read-out stays the same.

:class:`StillRows`: rows of the first minutes, averaged over time, for an alias at 0 Hz. They are
kept only until flicker and texture are separated for good: both take most of the memory and time
that an estimator needs there.
"""

from __future__ import annotations

from typing import Self

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.cell_light import CellLight, cell_means, still_light_of
from rsenf.flicker.tone import turning
from rsenf.flicker.zero_alias import MIN_BINS, ZeroAlias, separate
from rsenf.messages.schema import Float32Array, FloatArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

HARMONICS = 3
# Harmonics whose mean phasor is longer aren't used: slow changes of the scene look like them.
MOST_STILL = 0.3
SEGMENT_FRAMES, MOST_SEGMENTS = 128, 16
RIDGE = 1e-9  # of a Gram matrix's diagonal, for harmonics that aren't separable


class Moments:
    """Sufficient statistics of the frames so far.

    Parameters
    ----------
    rows : int

    Attributes
    ----------
    frames : int
        Number of frames.
    turn : ndarray of complex, shape (2·K + 1,)
        ``Σ_n exp(j·d·ψ_n)`` for ``d`` from 0 to ``2·K``.
    row : ndarray of complex, shape (K + 1, rows)
        ``r_k`` of each row, ``k`` from 0 to ``K``.
    contrast : ndarray, shape (rows - 1,)
        ``Σ_n (y[n] of the next row − y[n])²``: neighbours differ by noise.
    """

    def __init__(self, rows: int) -> None:
        self.frames = 0
        self.turn = np.zeros(2 * HARMONICS + 1, np.complex128)
        self.row = np.zeros((HARMONICS + 1, rows), np.complex128)
        self.contrast = np.zeros(rows - 1)

    def add(self, phase_rad: Float, level: Float) -> None:
        """Add frames.

        Parameters
        ----------
        phase_rad : ndarray, shape (frames,)
        level : ndarray, shape (frames, rows)
        """
        waves = turning(np.arange(2 * HARMONICS + 1)[:, None] * phase_rad)
        self.frames += phase_rad.size
        self.turn += waves.sum(axis=1)
        # Real products: a complex one would first convert all the levels to complex.
        fitted = waves[: HARMONICS + 1]
        self.row.real += fitted.real @ level
        self.row.imag -= fitted.imag @ level
        step = level[:, 1:] - level[:, :-1]
        self.contrast += np.einsum("nl,nl->l", step, step)

    def __iadd__(self, other: Moments) -> Self:
        self.frames += other.frames
        self.turn += other.turn
        self.row += other.row
        self.contrast += other.contrast
        return self

    def gram(self, orders: NDArray[np.int64]) -> Complex:
        """Gram matrix of some orders ``k``, shape (orders, orders)."""
        step = orders[None, :] - orders[:, None]
        below = self.turn[np.abs(step)]
        return np.asarray(np.where(step < 0, below.conj(), below))

    def response(self, orders: NDArray[np.int64]) -> Complex:
        """``r_k`` of some orders, shape (orders, rows)."""
        found = self.row[np.abs(orders)]
        return np.asarray(np.where(orders[:, None] < 0, found.conj(), found))

    def harmonics(self) -> int:
        """Number of harmonics, from the first on, that turn relative to the texture; at least 1.

        At 30 frames/s the third one of light at 50 Hz is as slow as the grid's deviation.
        """
        turned = np.abs(self.turn[2 : HARMONICS + 1]) < MOST_STILL * self.frames
        return 1 + int(np.argmin(np.append(turned, False)))

    def noise_var(self) -> float:
        """Mean variance of a row's level about its fit, from the differences of neighbours.

        Flicker beyond the fitted harmonics is the same in both, and cancels.
        """
        every = np.append(orders(HARMONICS), 0)
        response = np.diff(self.response(every), axis=1)
        gram = self.gram(every) + RIDGE * self.frames * np.eye(every.size)
        explained = np.sum(response.conj() * np.linalg.solve(gram, response), axis=0).real
        freedom = max(self.frames - every.size, 1)
        return float(np.mean(np.maximum(self.contrast - explained, 0.0))) / 2.0 / freedom

    def still_ratio(self) -> float:
        """Length of the mean phasor, or of the mean of its square if larger: 0 to 1.

        At 1 the flicker is static, or alternates by half a turn: it isn't separable from texture,
        or one sense of rotation from the other.
        """
        return float(np.max(np.abs(self.turn[1:3]))) / self.frames if self.frames else 1.0


class Segments:
    """Moments of a stream, and of each of its segments: as long as one another, but for the last.

    Parameters
    ----------
    rows : int

    Examples
    --------
    >>> segments = Segments(2)
    >>> segments.add(np.zeros(1100), np.ones((1100, 2)))
    >>> segments.whole.frames, [one.frames for one in segments.each]
    (1100, [128, 128, 128, 128, 128, 128, 128, 128, 76])
    """

    def __init__(self, rows: int) -> None:
        self.whole = Moments(rows)
        self.each: list[Moments] = []
        self._rows, self._frames = rows, SEGMENT_FRAMES

    def add(self, phase_rad: Float, level: Float) -> None:
        """Add frames, as :meth:`Moments.add` does."""
        while phase_rad.size:
            if not self.each or self.each[-1].frames == self._frames:
                self._begin()
            last = self.each[-1]
            room = self._frames - last.frames
            added = Moments(self._rows)
            added.add(phase_rad[:room], level[:room])
            last += added
            self.whole += added
            phase_rad, level = phase_rad[room:], level[room:]

    def _begin(self) -> None:
        """Begin a segment; two by two become one when there are too many."""
        if len(self.each) == MOST_SEGMENTS:
            self._frames *= 2
            for first, second in zip(self.each[::2], self.each[1::2], strict=True):
                first += second
            del self.each[1::2]
        self.each.append(Moments(self._rows))


def orders(harmonics: int) -> NDArray[np.int64]:
    """Orders ``±1 … ±harmonics``.

    >>> orders(2).tolist()
    [-2, -1, 1, 2]
    """
    up = np.arange(1, harmonics + 1)
    return np.concatenate((-up[::-1], up))


def row_tones(moments: Moments) -> tuple[Complex, Float]:
    """Half the complex amplitude of every row's first harmonic, and the row's level.

    Returns
    -------
    tone, level : ndarray, shape (rows,)
    """
    each = np.append(orders(1), 0)
    fit = np.linalg.solve(moments.gram(each), moments.response(each))
    return np.asarray(fit[1]), np.asarray(fit[2].real)


def coherence(tone: Complex, level: Float, turns: float) -> float:
    """Share of the tones that adds up along a ramp: 1 if all lie on it, about 0 by chance.

    Parameters
    ----------
    tone, level : ndarray, shape (rows,)
        As of :func:`row_tones`.
    turns : float
        Turns of the ramp down the rows.

    Examples
    --------
    >>> ramp = np.exp(2j * np.pi * 1.5 * np.arange(8) / 8)
    >>> round(coherence(ramp, np.ones(8), 1.5), 3), round(coherence(ramp, np.ones(8), -0.5), 3)
    (1.0, 0.0)
    """
    ramp = np.exp(2j * np.pi * turns * np.arange(tone.size) / tone.size)
    size = float(np.sum(level * np.abs(tone)))
    return float(np.abs(np.sum(level * tone * ramp.conj()))) / size if size > 0 else 0.0


SHORTEST_S = 8.0
# Longer bins would blur the phase that the grid's deviation turns.
LONGEST_S = 240.0
BIN_S = 0.25
MOST_BINS = 480  # even, since they merge in pairs


class RowBins:
    """Sums of rows in equal time bins, merged in pairs when there are too many.

    Two minutes in quarter seconds, four in half seconds, and so on. Frames are added one after
    the other, so that their division into blocks changes nothing.

    Parameters
    ----------
    start_s : float
        Start of the first bin.
    bin_s : float, optional
        Initial length of a bin.

    Examples
    --------
    >>> bins = RowBins(0.0)
    >>> bins.add(np.array([0.0, 0.2, 0.3]), np.array([2.0, 4.0, 5.0])[:, None, None])
    >>> level, t_s, frames = bins.means()
    >>> level[:, 0, 0].tolist(), frames.tolist()
    ([3.0, 5.0], [2.0, 1.0])
    """

    def __init__(self, start_s: float, bin_s: float = BIN_S) -> None:
        self.start_s, self.bin_s = start_s, bin_s
        self._t_s, self._frames = np.zeros(MOST_BINS), np.zeros(MOST_BINS)
        self._level: Float = np.empty((0, 0, 0))

    def add(self, t_s: Float, level: NDArray[np.floating]) -> None:
        """Add frames.

        Parameters
        ----------
        t_s : ndarray, shape (frames,)
            Times of the frames, none before the start.
        level : ndarray, shape (frames, rows, strips)
            Mean levels of their rows.
        """
        if not self._level.size:
            # One allocation: untouched pages cost nothing, and it is freed as a whole.
            self._level = np.zeros((MOST_BINS, *level.shape[1:]))
        for t, rows in zip(t_s.tolist(), level, strict=True):
            while (k := max(int((t - self.start_s) // self.bin_s), 0)) >= MOST_BINS:
                self._merge()
            self._level[k] += rows
            self._t_s[k] += t
            self._frames[k] += 1.0

    def _merge(self) -> None:
        self.bin_s *= 2.0
        for of in (self._level, self._t_s, self._frames):
            half = MOST_BINS // 2
            of[:half] = of[::2] + of[1::2]
            of[half:] = 0.0

    @property
    def count(self) -> int:
        """Number of bins with frames."""
        return int(np.count_nonzero(self._frames))

    def means(self) -> tuple[Float, Float, Float]:
        """Mean levels (bins, rows, strips), mean times (bins,) and numbers of frames (bins,).

        Bins without frames are left out.
        """
        there = np.flatnonzero(self._frames)
        frames = self._frames[there]
        level = self._level[there]
        level /= frames[:, None, None]
        return level, self._t_s[there] / frames, frames


class StillRows:
    """Time bins of rows, and the flicker found in them.

    Parameters
    ----------
    start_s : float
        Start of the first bin.

    Attributes
    ----------
    span_s : float
        Time covered.
    light : CellLight, optional
        Statistics of the cells at the flicker last found.
    """

    def __init__(self, start_s: float) -> None:
        self.span_s = 0.0
        self._start_s = start_s
        self._bins: RowBins | None = RowBins(start_s)  # None after the final separation
        self._found: ZeroAlias | None = None
        self.light: CellLight | None = None
        self._looked = self._full = False

    def add(self, t_s: FloatArray, level: Float32Array, end_s: float) -> None:
        """Add frames, for the first ``LONGEST_S``.

        Parameters
        ----------
        t_s : ndarray, shape (frames,)
        level : ndarray, shape (frames, rows, strips)
        end_s : float
            Length of the stream so far.
        """
        self._full = self._full or end_s - self._start_s >= LONGEST_S
        if self._bins is None or self._full:
            return
        self._bins.add(t_s, level)
        self.span_s, self._looked = end_s - self._start_s, False

    @property
    def enough(self) -> bool:
        """Whether they suffice: not those of a short stream, or of one with large gaps."""
        return self._bins is None or (self.span_s >= SHORTEST_S and self._bins.count >= MIN_BINS)

    @property
    def show_flicker(self) -> bool:
        """Whether flicker was separated from the texture in them."""
        found = self.told_apart() if self.enough else None
        return found is not None and found.is_flicker

    def told_apart(self) -> ZeroAlias | None:
        """Separate flicker and texture; None without flicker. Cached until frames are added."""
        if self._bins is not None and not self._looked:
            level, t_s, frames = self._bins.means()
            self._found, self._looked = separate(level, t_s, frames), True
            self.light = None
            if self._found is not None:
                turns, phase_rad = abs(self._found.turns) + 1.0, self._found.phase_rad
                cells = cell_means(level)
                means, bands = cells.reshape(len(cells), -1), cells.shape[1]
                self.light = still_light_of(means, t_s, phase_rad, bands, turns)
        if self._full:
            self._bins = None
        return self._found
