"""The paper's hypotheses on a clip's ENF, each correlated with a reference at every lag.

The hypotheses are on one axis. The peak correlation of each and its lag are kept (paper, Section
IV); the metrics choose among them (:mod:`rsenf.match.paper`). All series share their holes, so the
long series and the sums over the masks are transformed once; otherwise the result is that of
:func:`rsenf.match.ncc.lag_tables` without its tables.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rsenf.match.ncc import MIN_FFT, ROUNDING, BoolArray
from rsenf.match.search import ways
from rsenf.match.series import Grid, Track, to_step_of, uniform_axis
from rsenf.match.settings import MatchSettings
from rsenf.messages import EnfEstimate
from rsenf.messages.schema import FloatArray


@dataclass(frozen=True)
class Label:
    """The assumptions of one hypothesis; fields as in :class:`rsenf.messages.EnfEstimate`."""

    nominal_hz: float
    harmonic: int
    line_m: int
    line_hz: float
    idle_ratio: float


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Tracks on one axis, value ``i`` centred at ``first_s + i·hop_s`` from the clip's start.

    ``enf_hz`` has the shape (hypotheses, n), NaN where there is no usable estimate.
    """

    labels: tuple[Label, ...]
    first_s: float
    hop_s: float
    window_s: float
    enf_hz: FloatArray

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Where every hypothesis has a value, shape (n,)."""
        return np.asarray(np.isfinite(self.enf_hz).all(axis=0), np.bool_)

    @property
    def seconds(self) -> float:
        """Seconds of the clip in which every hypothesis has a value."""
        return float(self.usable.sum()) * self.hop_s

    def of_nominal(self, nominal_hz: float) -> Hypotheses:
        """Return only the hypotheses for grids of this nominal frequency."""
        kept = [i for i, x in enumerate(self.labels) if round(x.nominal_hz) == round(nominal_hz)]
        labels = tuple(self.labels[i] for i in kept)
        return replace(self, labels=labels, enf_hz=self.enf_hz[kept])

    def track(self, i: int) -> Track:
        """Return hypothesis ``i`` as a track, without variances."""
        nothing = np.full(self.enf_hz.shape[1], np.nan)
        nominal_hz = self.labels[i].nominal_hz
        return Track(self.first_s, self.hop_s, self.window_s, self.enf_hz[i], nothing, nominal_hz)


class HypothesisStore:
    """Keeps estimates of ranks other than 0 in compact arrays."""

    def __init__(self) -> None:
        self._row: dict[int, int] = {}  # of a rank
        self._labels: list[Label] = []
        self._rows: array[int] = array("q")
        self._end_ns: array[int] = array("q")
        self._t_s: array[float] = array("d")
        self._enf_hz: array[float] = array("d")
        self._window_s = 0.0

    def add(self, estimate: EnfEstimate) -> None:
        """Keep an estimate."""
        e = estimate
        if e.rank not in self._row:
            self._row[e.rank] = len(self._labels)
            self._labels.append(Label(e.nominal_hz, e.harmonic, e.line_m, e.line_hz, e.idle_ratio))
        self._window_s = (e.end_pts_ns - e.start_pts_ns) / 1e9
        self._rows.append(self._row[e.rank])
        self._end_ns.append(e.end_pts_ns)
        self._t_s.append(e.t_s)
        self._enf_hz.append(e.enf_hz if e.usable else np.nan)

    def hypotheses(self, until_ns: int | None = None) -> Hypotheses | None:
        """Return the estimates whose windows end by ``until_ns``; None if there are none."""
        end_ns = np.frombuffer(self._end_ns, np.int64) if self._rows else np.empty(0, np.int64)
        inside = end_ns <= (until_ns if until_ns is not None else np.iinfo(np.int64).max)
        if not inside.any():
            return None
        rows: NDArray[np.int64] = np.frombuffer(self._rows, np.int64)[inside]
        t_s = np.frombuffer(self._t_s, np.float64)[inside]
        first_s, hop_s, index = uniform_axis(t_s)
        enf_hz = np.full((len(self._labels), index.max() + 1), np.nan)
        enf_hz[rows, index] = np.frombuffer(self._enf_hz, np.float64)[inside]
        return Hypotheses(tuple(self._labels), first_s, hop_s, self._window_s, enf_hz)


def hypotheses_of(estimates: Iterable[EnfEstimate]) -> Hypotheses | None:
    """Collect the hypotheses of the tracker ``paper``; None if there are none.

    Its result, the estimates of rank 0, is left out.
    """
    store = HypothesisStore()
    for estimate in estimates:
        if estimate.rank != 0:
            store.add(estimate)
    return store.hypotheses()


class BestLags(NamedTuple):
    """The lag of the largest correlation of each series, with the values there.

    NaN if no lag has a correlation; ``offset`` is the mean of ``x − y``; ``compared`` lags had
    enough pairs.
    """

    lag: NDArray[np.int64]
    correlation: FloatArray
    offset: FloatArray
    pairs: NDArray[np.int64]
    compared: int


def best_lags(
    x: FloatArray, x_ok: BoolArray, y: FloatArray, y_ok: BoolArray, *, min_pairs: int
) -> BestLags:
    """Correlate at every lag with enough valid pairs (paper, Section IV).

    Parameters
    ----------
    x : ndarray, shape (series, n)
    x_ok : ndarray of bool, shape (n,)
        Where all of them are valid.
    y, y_ok : ndarray, shape (N,)
        The long series, and where it is valid.
    min_pairs : int
        Minimum number of pairs at a lag.

    Returns
    -------
    BestLags
        At lag ``l``, value ``x[i]`` is paired with ``y[i + l]``.
    """
    held = max(int(x_ok.sum()), 1)
    level_x, level_y = _means(x, x_ok), _means(y[None], y_ok)[0]
    x, y = np.where(x_ok, x - level_x, 0.0), np.where(y_ok, y - level_y, 0.0)
    least_x = ROUNDING * (x * x).sum(axis=1) / held
    least_y = ROUNDING * float(y @ y) / max(int(y_ok.sum()), 1)
    best, offset = (np.full(len(x), np.nan) for _ in range(2))
    lag, used = (np.zeros(len(x), np.int64) for _ in range(2))
    compared = 0
    for stretch in _stretches(x.shape[1], y, y_ok):
        pairs, sum_y, sum_yy = stretch.sums(x_ok.astype(np.float64), 0, 1, 2)
        enough = np.rint(pairs) >= max(min_pairs, 1)
        compared += int(enough.sum())
        n = np.where(enough, np.rint(pairs), 1.0)
        mean_y = sum_y / n
        var_y = sum_yy / n - mean_y**2
        for i, one in enumerate(x):
            sum_x, sum_xy = stretch.sums(one, 0, 1)
            (sum_xx,) = stretch.sums(one * one, 0)
            mean_x = sum_x / n
            var_x = sum_xx / n - mean_x**2
            varies = enough & (var_x > least_x[i]) & (var_y > least_y)
            spread = np.sqrt(np.where(varies, var_x * var_y, 1.0))
            correlation = np.where(varies, (sum_xy / n - mean_x * mean_y) / spread, -np.inf)
            top = int(np.argmax(correlation))
            if varies[top] and not correlation[top] <= best[i]:
                best[i], lag[i], used[i] = correlation[top], stretch.first + top, n[top]
                offset[i] = mean_x[top] - mean_y[top]
    offset += level_x[:, 0] - level_y
    return BestLags(lag, np.clip(best, -1.0, 1.0), offset, used, compared)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """``count`` lags from ``first`` on; ``spectra`` of the long series' powers 0, 1 and 2."""

    first: int
    count: int
    size: int
    spectra: NDArray[np.complex128]

    def sums(self, short: FloatArray, *powers: int) -> FloatArray:
        """Return sums of a short series times the long one's powers, shape (powers, count)."""
        from scipy import fft

        spectrum = np.conj(fft.rfft(short, self.size))
        sums = fft.irfft(spectrum * self.spectra[list(powers)], self.size)
        return np.asarray(sums[:, : self.count], np.float64)


def _stretches(length: int, y: FloatArray, y_ok: BoolArray) -> Iterator[_Stretch]:
    """Cut the long series into overlapping stretches, each lag in one of them."""
    from scipy import fft

    size = fft.next_fast_len(max(MIN_FFT, 4 * length), real=True)
    for first in range(1 - length, y.size, size - length + 1):
        part = slice(max(first, 0), min(first + size, y.size))
        beyond = (part.start - first, first + size - part.stop)
        valid, long = np.pad(y_ok[part].astype(np.float64), beyond), np.pad(y[part], beyond)
        spectra = fft.rfft(np.stack([valid, long, long * long]))
        yield _Stretch(first, min(size - length + 1, y.size - first), size, spectra)


def _means(v: FloatArray, ok: BoolArray) -> FloatArray:
    """Mean of each row's valid values, shape (rows, 1); 0 if there are none."""
    return np.asarray(v[:, ok].mean(axis=1, keepdims=True) if ok.any() else np.zeros((len(v), 1)))


@dataclass(frozen=True, eq=False)
class Tally:
    """The peak correlation of every hypothesis and its lag; arrays of shape (hypotheses,).

    NaN if no lag could be compared. ``seconds`` were compared at the peak, ``offset_hz`` is the ENF
    less the reference there, and ``lags`` is the number of lags compared for each hypothesis.
    """

    hypotheses: Hypotheses
    settings: MatchSettings
    lag_s: FloatArray
    correlation: FloatArray
    offset_hz: FloatArray
    seconds: FloatArray
    lags: int


def paper_search(hypotheses: Hypotheses, grid: Grid, settings: MatchSettings) -> Tally:
    """Correlate every hypothesis with a reference at every lag (paper, Section IV).

    Estimates with a 20 s window are averages, and so is the paper's reference, whose ENF is
    estimated with the same window. Therefore the reference is averaged likewise, unless
    ``smoothing`` is ``none``. A window that one hypothesis lacks is left out for all.

    Parameters
    ----------
    hypotheses : Hypotheses
        Of one nominal frequency, the reference's.
    grid : Grid
    settings : MatchSettings

    Raises
    ------
    UsageError
        If neither time step is a whole multiple of the other.
    """
    one, ok = hypotheses.track(0), hypotheses.usable
    smoothing = "none" if settings.smoothing == "none" else "window"
    grid = ways(one, to_step_of(one, grid), smoothing)[0].grid
    least_s = max(settings.min_overlap * hypotheses.seconds, settings.min_seconds)
    # A coarser reference is compared with every ``thin``-th estimate, for each starting offset.
    thin = round(grid.step_s / hypotheses.hop_s)
    found = [
        best_lags(
            hypotheses.enf_hz[:, way::thin],
            ok[way::thin],
            grid.freq_hz,
            np.isfinite(grid.freq_hz),
            min_pairs=max(3, math.ceil(least_s / grid.step_s)),
        )
        for way in range(thin)
    ]
    best = np.argmax([np.nan_to_num(f.correlation, nan=-np.inf) for f in found], axis=0)

    def of_best(values: Sequence[NDArray[Any]]) -> FloatArray:
        return np.asarray(np.stack(values)[best, np.arange(best.size)], np.float64)

    first_s = hypotheses.first_s + best * hypotheses.hop_s
    correlation = of_best([f.correlation for f in found])
    lag_s = (of_best([f.lag for f in found]) + 0.5) * grid.step_s - first_s
    return Tally(
        hypotheses=hypotheses,
        settings=settings,
        lag_s=np.where(np.isnan(correlation), np.nan, lag_s),
        correlation=correlation,
        offset_hz=of_best([f.offset for f in found]),
        seconds=of_best([f.pairs for f in found]) * grid.step_s,
        lags=sum(f.compared for f in found),
    )
