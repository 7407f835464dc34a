"""The ENF of one clip under every hypothesis of the paper's method, on one axis."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.match.series import Track, uniform_axis
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

    def __len__(self) -> int:
        return len(self._rows)

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
        end_ns = np.frombuffer(self._end_ns, np.int64) if len(self) else np.empty(0, np.int64)
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
