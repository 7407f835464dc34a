"""How well a clip fits a reference at a lag: a log-likelihood, and a peak's exact place.

Residuals are Gaussian of unknown size about a constant offset, whose prior is the clock errors of
cameras. A 20 s window that moves on by 1 s gives far fewer independent values than seconds, and so
does a grid that takes its time: residuals count once per half of it, as the half-overlapping
segments of a Welch spectrum do.

Correlation alone would rank a lag by its shape only; the offset (a clock error of 100 ppm is 5 mHz)
and the size of the residual tell more. All three come from the same masked sums.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.match.ncc import Comparison, LagTable, Residuals, compare_at, lag_residuals, lag_tables
from rsenf.match.series import Track
from rsenf.match.settings import MatchSettings
from rsenf.messages.schema import FloatArray

INDEPENDENT_RATIO = 0.5  # of the resolution: the spacing at which residuals count as independent
CLOCK_DOF = 3.0  # of the Student prior: tails that real cameras need
# Two honest recordings of one grid differ by this much; a smaller residual says no more.
FLOOR_STD_HZ = 1e-4
SAMPLED_LAGS = 401  # from which the residual of an ordinary lag is taken


@dataclass(frozen=True)
class Peak:
    """One lag with its comparison, refined to a fraction of a step.

    ``score`` is the log-likelihood (nats) over that of an ordinary lag; ``bend_hz2_per_s2`` is by
    how much the residual variance grows with the square of the distance from the lag, 0 where it
    has no minimum there.
    """

    lag_s: float
    score: float
    seconds: float
    correlation: float
    offset_hz: float
    residual_var_hz2: float
    bend_hz2_per_s2: float


def independent_values(seconds: float, resolution_s: float) -> float:
    """How many independent residuals so many seconds are worth."""
    return seconds / (INDEPENDENT_RATIO * resolution_s)


class LagScorer:
    """Compares a track with a reference on the track's step.

    Parameters
    ----------
    track : Track
    freq_hz : ndarray, shape (N,)
        The reference, NaN in gaps.
    settings : MatchSettings
    usable_s : float
        Usable seconds of the whole clip, of which a lag must use a share.
    """

    def __init__(
        self, track: Track, freq_hz: FloatArray, settings: MatchSettings, usable_s: float
    ) -> None:
        self.track, self.settings = track, settings
        self.x, self.x_ok = track.enf_hz, np.isfinite(track.enf_hz)
        self.y, self.y_ok = freq_hz, np.isfinite(freq_hz)
        least_s = max(settings.min_overlap * usable_s, settings.min_seconds)
        self.min_pairs = max(3, int(np.ceil(least_s / track.hop_s)))
        self.ordinary_var_hz2 = 1.0

    def lag_s(self, lag: float) -> float:
        """Start of the clip on the reference's axis when value 0 meets sample ``lag``."""
        return (lag + 0.5) * self.track.hop_s - self.track.first_s

    def lags_s(self, lags: NDArray[np.int64]) -> FloatArray:
        """Do the same for many lags."""
        return np.asarray((lags + 0.5) * self.track.hop_s - self.track.first_s, np.float64)

    def nearest_lag(self, lag_s: float) -> int:
        """Inverse of :meth:`lag_s`."""
        return round((lag_s + self.track.first_s) / self.track.hop_s - 0.5)

    def residuals(self) -> Iterator[Residuals]:
        """Compare at every lag."""
        return lag_residuals(self.x, self.x_ok, self.y, self.y_ok, min_pairs=self.min_pairs)

    def tables(self) -> Iterator[LagTable]:
        """Compare at every lag, with the correlation too."""
        return lag_tables(self.x, self.x_ok, self.y, self.y_ok, min_pairs=self.min_pairs)

    def scores(self, pairs: NDArray[np.int64], offset: FloatArray, var: FloatArray) -> FloatArray:
        """Log-likelihood of each lag over that of an ordinary one; NaN where not compared.

        Fewer pairs give less evidence, for or against.
        """
        values = independent_values(1.0, self.track.resolution_s) * self.track.hop_s * pairs
        ratio = np.maximum(var, FLOOR_STD_HZ**2) / self.ordinary_var_hz2
        ppm = offset / self.track.nominal_hz * 1e6
        clock = np.log1p((ppm / self.settings.clock_scale_ppm) ** 2 / CLOCK_DOF)
        score = -0.5 * np.maximum(values - 1, 0) * np.log(ratio) - 0.5 * (CLOCK_DOF + 1) * clock
        return np.asarray(score, np.float64)

    def sample_ordinary_var(self) -> float:
        """Residual variance of an ordinary lag: the median of some spread over the reference."""
        lags = np.linspace(1 - self.x.size, self.y.size - 1, SAMPLED_LAGS).astype(int)
        found = [self._at(int(lag)) for lag in np.unique(lags)]
        variances = [c.residual_var for c in found if c.pairs >= self.min_pairs]
        fallback = self.y[self.y_ok].var() if self.y_ok.any() else 0.0
        return max(float(np.median(variances) if variances else fallback), FLOOR_STD_HZ**2)

    def peak(self, lag: int) -> Peak:
        """Compare at a lag; go to the vertex between its neighbours when it is a minimum.

        Near the truth the residual variance is a parabola over the lag: a shift ``δ`` adds
        ``δ²`` times the mean square of the reference's slope.
        """
        here, before, after = self._at(lag), self._at(lag - 1), self._at(lag + 1)
        shift, bend = 0.0, 0.0
        if min(before.pairs, after.pairs) >= self.min_pairs:
            bend = max((before.residual_var + after.residual_var) / 2 - here.residual_var, 0.0)
            if here.residual_var < min(before.residual_var, after.residual_var):
                shift = (before.residual_var - after.residual_var) / (4 * bend)
        three = (before, here, after) if shift else (here, here, here)
        var = max(_quadratic([c.residual_var for c in three], shift), 0.0)
        offset = _quadratic([c.offset for c in three], shift)
        correlation = _quadratic([c.correlation for c in three], shift)
        score = self.scores(np.array([here.pairs]), np.array([offset]), np.array([var]))
        return Peak(
            lag_s=self.lag_s(lag + shift),
            score=float(score[0]),
            seconds=here.pairs * self.track.hop_s,
            correlation=float(np.clip(correlation, -1.0, 1.0)),
            offset_hz=offset,
            residual_var_hz2=var,
            bend_hz2_per_s2=bend / self.track.hop_s**2,
        )

    def _at(self, lag: int) -> Comparison:
        return compare_at(self.x, self.x_ok, self.y, self.y_ok, lag)


def _quadratic(three: list[float], shift: float) -> float:
    """Value of the parabola through points at −1, 0 and 1."""
    a, b, c = three
    return b + shift * (c - a) / 2 + shift**2 * ((a + c) / 2 - b)
