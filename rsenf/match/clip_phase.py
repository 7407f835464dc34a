"""The flicker's phase during a clip, once per hop, and its averages under a window.

If an estimator publishes complex amplitudes, each phase comes from the frames of its own window
only, so the errors are independent. If it publishes frequencies only, the phase is their running
sum, and its error is a random walk.

A windowed frequency estimate averages the frequency under a kernel that follows from the phase.
The maximum of a windowed periodogram is, for the small phase wander of a grid, the slope of the
weighted least-squares line through the phase ``φ(t)``::

    f = ∫ w(t)·t·φ(t) dt / (2π ∫ w(t)·t² dt)

(expand ``|∫ w exp(j(φ − ωt)) dt|²`` to second order in the phase: it falls with the weighted
variance of ``φ − ωt``). With ``φ = 2π∫f`` and one integration by parts this is an average of the
instantaneous frequency, ``f = ∫ k(s)·f(s) ds``, with the kernel::

    k(s) = ∫_s^∞ w(t)·t dt / ∫ w(t)·t² dt

It is bell-shaped and narrower than the window. A reference averaged by it is comparable with the
estimate. A day of the continental grid differs from its own average under a 20 s Hann window by
1.5 mHz rms, which is most of the difference between a clean estimate and the reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.match.series import Track
from rsenf.messages.schema import FloatArray

_FINE = 4096  # intervals of the numerical integral; its error is far below a reference's last digit
# Illumination phase per cycle of the grid: light flickers at twice the grid's frequency.
RAD_PER_CYCLE = 4.0 * np.pi
LONGEST_LINK_RATIO = 1.5  # of the hop: longest step over which frequencies are integrated
LONGEST_WINDOW_RATIO = 1.5  # of the hop: longer windows overlap, and can't be summed to a phase
# References that are averages already were mostly made with a 20 s window.
AVERAGED_S = 20.0
LEAST_AVERAGED = 5  # fewest averaged phases that are of use
LEAST_THERE = 0.8  # least share of an average's weights that must fall on measured phases


def window_kernel(window_s: float, step_s: float) -> FloatArray:
    """Weights by which an estimate under a Hann window averages a reference's samples.

    Parameters
    ----------
    window_s : float
        Length of the Hann window.
    step_s : float
        Time between the reference's samples, each a mean over its step.

    Returns
    -------
    ndarray, odd length
        Symmetric weights that sum to 1; the estimate is centred on the middle sample.

    Examples
    --------
    >>> window_kernel(4.0, 1.0).round(3).tolist()
    [0.005, 0.229, 0.531, 0.229, 0.005]
    """
    t = np.linspace(-window_s / 2, window_s / 2, _FINE + 1)
    moment = np.cos(np.pi * t / window_s) ** 2 * t
    rest = -_cumulative(moment, t)  # ∫_s^∞ w·t dt: the whole integral is zero
    area = _cumulative(rest, t)
    reach = int(np.floor((window_s / 2) / step_s + 0.5))
    edges = (np.arange(-reach, reach + 2) - 0.5) * step_s
    weights = np.diff(np.interp(edges, t, area))
    return np.asarray(weights / weights.sum(), np.float64)


def box_kernel(length_s: float, step_s: float) -> FloatArray:
    """Weights that average values of one step over a longer step, about the middle value.

    If the longer step holds an even number of values, the two at its ends get half a weight.

    Parameters
    ----------
    length_s : float
        The longer step.
    step_s : float

    Examples
    --------
    >>> box_kernel(2.0, 1.0).tolist()
    [0.25, 0.5, 0.25]
    """
    half = length_s / step_s / 2
    reach = int(half + 0.5 - 1e-9)
    weights = np.diff(np.clip(np.arange(-reach, reach + 2) - 0.5, -half, half))
    return np.asarray(weights / weights.sum(), np.float64)


def _cumulative(v: FloatArray, t: FloatArray) -> FloatArray:
    """Running trapezoidal integral from the first point."""
    return np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * np.diff(t))])


def average(freq_hz: FloatArray, weights: FloatArray, least_ratio: float = 1.0) -> FloatArray:
    """Average a series with gaps under symmetric weights.

    Parameters
    ----------
    freq_hz : ndarray, shape (n,)
        NaN in gaps.
    weights : ndarray, odd length
        Summing to 1.
    least_ratio : float
        Share of the weights that must fall on valid values.

    Returns
    -------
    ndarray, shape (n,)
        NaN where less than that share does, and near both ends.

    Examples
    --------
    >>> average(np.array([1.0, 2.0, 4.0, np.nan]), np.array([0.25, 0.5, 0.25])).tolist()
    [nan, 2.25, nan, nan]
    """
    if freq_hz.size < weights.size:
        return np.full(freq_hz.size, np.nan)
    ok = np.isfinite(freq_hz)
    level = float(freq_hz[ok].mean()) if ok.any() else 0.0
    half = weights.size // 2
    out = np.full(freq_hz.size, np.nan)
    met = np.convolve(ok, weights, "valid")
    enough = met > least_ratio - 1e-9
    total = np.convolve(np.where(ok, freq_hz - level, 0.0), weights, "valid")
    smooth = level + total / np.where(enough, met, 1.0)
    out[half : freq_hz.size - half] = np.where(enough, smooth, np.nan)
    return out


@dataclass(frozen=True, eq=False)
class ClipPhase:
    """Phases at some times of a clip."""

    t_s: FloatArray  # (n,) times from the clip's first frame, rising; a whole number of hops apart
    # (n,) phase of the illumination less that of twice the nominal frequency, by the camera's clock
    phase_rad: FloatArray
    var_rad2: FloatArray  # (n,) variance of each phase, independent of the others
    # (n,) variance that the error gains from the time before to this one; 0 for measured phases
    walk_rad2: FloatArray
    hop_s: float
    nominal_hz: float  # 50 or 60

    @property
    def size(self) -> int:
        """Number of phases."""
        return int(self.t_s.size)

    @property
    def is_summed(self) -> bool:
        """Whether the phases are running sums of frequencies, not measured phases."""
        return bool(self.walk_rad2.any())

    @property
    def linked(self) -> NDArray[np.bool_]:
        """Whether each phase step is known; a sum of frequencies has no known step over a hole."""
        if not self.is_summed:
            return np.ones(self.size, np.bool_)
        return np.diff(self.t_s, prepend=self.t_s[:1]) < LONGEST_LINK_RATIO * self.hop_s

    def between(self, start: int, stop: int) -> ClipPhase:
        """Return a range of the phases, with the same time origin."""
        return self._of(slice(start, stop))

    def only(self, selected: NDArray[np.bool_]) -> ClipPhase:
        """Return the selected phases; a sum of frequencies has no known step over the others."""
        return self if selected.all() else self._of(selected)

    def _of(self, part: slice | NDArray[np.bool_]) -> ClipPhase:
        return ClipPhase(
            self.t_s[part], self.phase_rad[part], self.var_rad2[part], self.walk_rad2[part],
            self.hop_s, self.nominal_hz,
        )  # fmt: skip


def clip_phase(track: Track) -> ClipPhase | None:
    """Return a track's phases; None if its windows overlap too much to sum its frequencies."""
    if track.window_s > LONGEST_WINDOW_RATIO * track.hop_s:
        return None
    valid = np.isfinite(track.phase_rad) & np.isfinite(track.enf_hz)
    if valid.sum() >= 0.5 * track.usable:
        return _measured(track, valid)
    return _summed(track)


def _measured(track: Track, valid: np.ndarray) -> ClipPhase:
    """Take the measured phases, unwrapped with the help of the estimated frequency."""
    index = np.flatnonzero(valid)
    t_s = np.asarray(track.first_s + index * track.hop_s, np.float64)
    expected = _walked(t_s, track.enf_hz[index] - track.nominal_hz)
    phase = expected + np.unwrap(track.phase_rad[index] - expected)
    return ClipPhase(
        t_s, phase, track.phase_var_rad2[index], np.zeros(index.size),
        track.hop_s, track.nominal_hz,
    )  # fmt: skip


def _summed(track: Track) -> ClipPhase:
    """Integrate the frequency estimates; each adds its own variance over one hop."""
    index = np.flatnonzero(np.isfinite(track.enf_hz))
    t_s = np.asarray(track.first_s + index * track.hop_s, np.float64)
    per_hop = (RAD_PER_CYCLE * track.hop_s) ** 2
    walk = per_hop * np.diff(np.cumsum(track.var_hz2[index]), prepend=0.0)
    phase = _walked(t_s, track.enf_hz[index] - track.nominal_hz)
    return ClipPhase(t_s, phase, np.zeros(index.size), walk, track.hop_s, track.nominal_hz)


def _walked(t_s: FloatArray, away_hz: FloatArray) -> FloatArray:
    """Phase by the trapezoidal rule; over a hole, from the frequencies at its ends."""
    steps = RAD_PER_CYCLE * np.diff(t_s) * (away_hz[1:] + away_hz[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def averaged(clip: ClipPhase) -> ClipPhase | None:
    """Return a clip's phases averaged under a 20 s Hann window, 10 s apart.

    For references that are such averages and so carry no faster changes. Holes are interpolated
    linearly, and a mean needs 80 % of its weights on measured phases. None if the clip is too
    short.
    """
    weights = window_kernel(AVERAGED_S, clip.hop_s)
    index = np.rint((clip.t_s - clip.t_s[0]) / clip.hop_s).astype(np.int64)
    count, reach = int(index[-1]) + 1, weights.size // 2
    middle = np.arange(reach, count - reach, max(round(AVERAGED_S / 2 / clip.hop_s), 1))
    every = np.arange(count)
    there = np.isin(every, index)
    phase = np.interp(every, index, clip.phase_rad)
    var = np.interp(every, index, clip.var_rad2 + clip.walk_rad2 * (AVERAGED_S / clip.hop_s))

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
