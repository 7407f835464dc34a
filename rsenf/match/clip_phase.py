"""The flicker's phase through a clip, second by second: what the phase matcher follows.

An estimator that publishes amplitudes gives the phase of each second by that second's own frames,
so that errors of different seconds have nothing to do with each other. From one that publishes
frequencies only, the phase is their running sum, which wanders as their errors do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.match.kernel import window_kernel
from rsenf.match.series import Track
from rsenf.messages.schema import FloatArray

# Of the illumination's phase: it flickers at twice the grid's frequency.
RAD_PER_CYCLE = 4.0 * np.pi
LONGEST_LINK_RATIO = 1.5  # of the hop: the longest way over which frequencies tell the phase
LONGEST_WINDOW_RATIO = 1.5  # of the hop: longer windows overlap, and their values aren't a phase

# References that are averages already are so by a 20 s window, mostly.
AVERAGED_S = 20.0
LEAST_AVERAGED = 5  # phases, and the share of each one's weights that must rest on measured ones
LEAST_THERE = 0.8


@dataclass(frozen=True, eq=False)
class ClipPhase:
    """Phases at some instants of a clip.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Instants from the clip's first frame, rising; whole hops apart, where none is missing.
    phase_rad : ndarray, shape (n,)
        Illumination's phase less that of twice the nominal frequency, on the camera's clock.
    var_rad2 : ndarray, shape (n,)
        Variance of each, independent of the others'.
    walk_rad2 : ndarray, shape (n,)
        Variance by which errors grow from the instant before to this one.
    hop_s : float
    nominal_hz : float
    """

    t_s: FloatArray
    phase_rad: FloatArray
    var_rad2: FloatArray
    walk_rad2: FloatArray
    hop_s: float
    nominal_hz: float

    @property
    def size(self) -> int:
        """How many there are."""
        return int(self.t_s.size)

    @property
    def is_summed(self) -> bool:
        """Whether they are running sums of frequencies, and no phases that were measured."""
        return bool(self.walk_rad2.any())

    @property
    def linked(self) -> NDArray[np.bool_]:
        """Whether the way from each one before is known; over a hole, no sum of frequencies is."""
        if not self.is_summed:
            return np.ones(self.size, np.bool_)
        return np.diff(self.t_s, prepend=self.t_s[:1]) < LONGEST_LINK_RATIO * self.hop_s

    def between(self, start: int, stop: int) -> ClipPhase:
        """Return a part of it, on the same clock."""
        return self._of(slice(start, stop))

    def only(self, own: NDArray[np.bool_]) -> ClipPhase:
        """Return some of it; the way of a sum over the others is lost."""
        return self if own.all() else self._of(own)

    def _of(self, own: slice | NDArray[np.bool_]) -> ClipPhase:
        return ClipPhase(
            self.t_s[own], self.phase_rad[own], self.var_rad2[own], self.walk_rad2[own],
            self.hop_s, self.nominal_hz,
        )  # fmt: skip


def clip_phase(track: Track) -> ClipPhase | None:
    """Return a track's phases; None where its windows overlap, so that it has none."""
    if track.window_s > LONGEST_WINDOW_RATIO * track.hop_s:
        return None
    own = np.isfinite(track.phase_rad) & np.isfinite(track.enf_hz)
    if own.sum() >= 0.5 * track.usable:
        return _measured(track, own)
    return _summed(track)


def _measured(track: Track, own: np.ndarray) -> ClipPhase:
    """Take the phases as they are, and undo their jumps of 2π by the estimated frequency."""
    index = np.flatnonzero(own)
    t_s = np.asarray(track.first_s + index * track.hop_s, np.float64)
    expected = _walked(t_s, track.enf_hz[index] - track.nominal_hz)
    phase = expected + np.unwrap(track.phase_rad[index] - expected)
    return ClipPhase(
        t_s, phase, track.phase_var_rad2[index], np.zeros(index.size),
        track.hop_s, track.nominal_hz,
    )  # fmt: skip


def _summed(track: Track) -> ClipPhase:
    """Integrate the frequency: value ``i`` moves the phase over its own hop."""
    index = np.flatnonzero(np.isfinite(track.enf_hz))
    t_s = np.asarray(track.first_s + index * track.hop_s, np.float64)
    per_hop = (RAD_PER_CYCLE * track.hop_s) ** 2
    walk = per_hop * np.diff(np.cumsum(track.var_hz2[index]), prepend=0.0)
    phase = _walked(t_s, track.enf_hz[index] - track.nominal_hz)
    return ClipPhase(t_s, phase, np.zeros(index.size), walk, track.hop_s, track.nominal_hz)


def _walked(t_s: FloatArray, away_hz: FloatArray) -> FloatArray:
    """Phase by the trapezoidal rule; over a hole, by the frequencies at its ends."""
    steps = RAD_PER_CYCLE * np.diff(t_s) * (away_hz[1:] + away_hz[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def averaged(clip: ClipPhase) -> ClipPhase | None:
    """Return a clip's phases averaged as a 20 s window averages, as far apart as that leaves them.

    For references that are such averages: of what is faster they know nothing. None where the
    clip is too short for it. Holes are bridged by a line, and a mean must rest on few of them.
    """
    weights = window_kernel(AVERAGED_S, clip.hop_s)
    index = np.rint((clip.t_s - clip.t_s[0]) / clip.hop_s).astype(np.int64)
    count, reach = int(index[-1]) + 1, weights.size // 2
    middle = np.arange(reach, count - reach, max(round(AVERAGED_S / 2 / clip.hop_s), 1))
    every = np.arange(count)
    there = np.isin(every, index)
    phase = np.interp(every, index, clip.phase_rad)
    var = np.interp(every, index, clip.var_rad2 + clip.walk_rad2 * AVERAGED_S)

    def mean(values: FloatArray, by: FloatArray) -> FloatArray:
        return np.asarray(np.convolve(values, by, "valid")[middle - reach], np.float64)

    if middle.size < LEAST_AVERAGED:
        return None
    kept = mean(there.astype(float), weights) >= LEAST_THERE
    if kept.sum() < LEAST_AVERAGED:
        return None
    return ClipPhase(
        t_s=clip.t_s[0] + middle[kept] * clip.hop_s,
        phase_rad=mean(phase, weights)[kept],
        var_rad2=mean(var, weights**2)[kept],
        walk_rad2=np.zeros(int(kept.sum())),
        hop_s=clip.hop_s,
        nominal_hz=clip.nominal_hz,
    )
