"""The two series compared, each on a uniform axis with holes: a clip's ENF and a reference.

Estimates that jump away from their neighbours, as no windowed grid does, are made holes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.match.estimates import Rows, rows_of
from rsenf.medians import means
from rsenf.messages import EnfEstimate, ReferenceBlock
from rsenf.messages.schema import FloatArray

# Correlation time of the difference between two times of a grid.
GRID_MEMORY_S = 20.0
# A day of the continental grid, averaged by a 20 s window, stays within 8 mHz of its running median
# over 20 s. A value further away *and* far outside the clip's scatter is a wrong spectral peak; a
# few of those would make the right time look impossible.
LEAST_JUMP_HZ = 0.010
SCATTERS = 8.0  # standard deviations, from the median absolute deviation


@dataclass(frozen=True, eq=False)
class Track:
    """ENF estimates of one clip; value ``i`` is centred at ``first_s + i·hop_s`` from its start."""

    first_s: float
    hop_s: float
    window_s: float
    enf_hz: FloatArray  # (n,) NaN where there is no usable estimate
    var_hz2: FloatArray  # (n,) stated variance of the estimates about the grid's 1 s mean
    nominal_hz: float  # 50 or 60; NaN if unknown
    # (n,) illumination's phase in the middle of each window less that of twice the nominal
    # frequency, between −π and π, and its variance; NaN for estimates without a phase
    phase_rad: FloatArray = field(default_factory=lambda: np.empty(0))
    phase_var_rad2: FloatArray = field(default_factory=lambda: np.empty(0))
    # frequency about which the track is mirrored if the read-out direction is opposite to the one
    # assumed; NaN if the direction is known
    mirror_hz: float = float("nan")
    # number of tracks of the same clip, under different assumptions, that are compared (1 for this
    # one only)
    alternatives: int = 1

    def __post_init__(self) -> None:
        if not self.phase_rad.size:
            nothing = np.full(self.enf_hz.size, np.nan)
            object.__setattr__(self, "phase_rad", nothing)
            object.__setattr__(self, "phase_var_rad2", nothing)

    @property
    def usable(self) -> int:
        """Number of usable values."""
        return int(np.isfinite(self.enf_hz).sum())

    @property
    def directions(self) -> int:
        """Number of read-out directions to compare."""
        return 1 if math.isnan(self.mirror_hz) else 2

    @property
    def hypotheses(self) -> int:
        """Number of tracks in the search, of which one is right."""
        return self.directions * self.alternatives

    def between(self, first: int, last: int) -> Track:
        """Return a range of the values, with the same time origin."""
        return self.part(first, slice(first, last), self.hop_s)

    def part(self, first: int, chosen: slice, hop_s: float) -> Track:
        """Return chosen values, of which value ``first`` is the first, with the hop they have."""
        return replace(
            self,
            first_s=self.first_s + first * self.hop_s,
            hop_s=hop_s,
            enf_hz=self.enf_hz[chosen],
            var_hz2=self.var_hz2[chosen],
            phase_rad=self.phase_rad[chosen],
            phase_var_rad2=self.phase_var_rad2[chosen],
        )

    def mirrored(self) -> Track:
        """Return the track for the opposite read-out direction."""
        t_s = self.first_s + self.hop_s * np.arange(self.enf_hz.size, dtype=np.float64)
        return replace(
            self,
            enf_hz=2.0 * self.mirror_hz - self.enf_hz,
            phase_rad=_mirrored_phase(self.phase_rad, t_s, self.mirror_hz - self.nominal_hz),
        )

    @property
    def resolution_s(self) -> float:
        """Correlation time of residuals at a lag: the window's length, or the grid's own."""
        return max(self.window_s, GRID_MEMORY_S)


@dataclass(frozen=True, eq=False)
class Grid:
    """A reference: sample ``k`` is the mean over ``[k, k + 1)·step_s`` from its start.

    ``freq_hz`` (n,) is NaN in gaps. ``t0_ns`` is UTC since 1970, or 0 if unknown; with an unknown
    time zone it may be off by whole hours.
    """

    name: str
    nominal_hz: float
    t0_ns: int
    step_s: float
    freq_hz: FloatArray
    zone_unknown: bool = False

    @property
    def duration_s(self) -> float:
        """Time from the first sample's start to the last one's end."""
        return self.freq_hz.size * self.step_s


def track_of(estimates: Sequence[EnfEstimate]) -> Track:
    """Put estimates on their uniform axis; missing or unusable ones are holes.

    The hop is the median distance of different times. Raises ``ValueError`` without estimates.
    """
    return track_of_rows(rows_of(estimates))


def track_of_rows(rows: Rows) -> Track:
    """Make the same from kept estimates."""
    rows = rows[np.argsort(rows["start_ns"] + rows["end_ns"], kind="stable")]
    rows = _of_one_direction(rows)
    first_s, hop_s, index = uniform_axis(rows["t_s"])
    good = rows["usable"] & np.isfinite(rows["enf_hz"])

    def on_axis(name: str) -> FloatArray:
        out = np.full(index[-1] + 1, np.nan)
        out[index[good]] = rows[name][good]
        return out

    nominals = rows["nominal_hz"][rows["usable"] & np.isfinite(rows["nominal_hz"])]
    mirrors_hz = rows["mirror_hz"][good]
    is_open = good.any() and bool(np.isfinite(mirrors_hz).all())
    return Track(
        first_s=first_s,
        hop_s=hop_s,
        window_s=float(rows["end_ns"][0] - rows["start_ns"][0]) / 1e9,
        enf_hz=on_axis("enf_hz"),
        var_hz2=on_axis("var_hz2"),
        nominal_hz=float(np.median(nominals)) if nominals.size else float("nan"),
        phase_rad=on_axis("phase_rad"),
        phase_var_rad2=on_axis("phase_var_rad2"),
        mirror_hz=float(np.median(mirrors_hz)) if is_open else float("nan"),
    )


def _of_one_direction(rows: Rows) -> Rows:
    """Mirror estimates that assume another read-out direction than the rest.

    The direction is that of the estimates that know it, or else that of the majority.
    """
    good = rows["usable"] & np.isfinite(rows["enf_hz"])
    is_assumed = good & np.isfinite(rows["mirror_hz"])
    if not is_assumed.any():
        return rows
    telling = good & ~is_assumed if (good & ~is_assumed).any() else good
    is_reverse = 2 * np.count_nonzero(rows["is_reverse"][telling]) > np.count_nonzero(telling)
    wrong = is_assumed & (rows["is_reverse"] != is_reverse)
    rows = rows.copy()
    mirrored = rows[wrong]
    rows["enf_hz"][wrong] = 2.0 * mirrored["mirror_hz"] - mirrored["enf_hz"]
    rows["phase_rad"][wrong] = _mirrored_phase(
        mirrored["phase_rad"], mirrored["t_s"], mirrored["mirror_hz"] - mirrored["nominal_hz"]
    )
    return rows


def _mirrored_phase(
    phase_rad: FloatArray, t_s: FloatArray, off_hz: FloatArray | float
) -> FloatArray:
    """Mirror a phase, relative to the nominal's, about ``off_hz`` (of the grid) above that."""
    return np.asarray(np.angle(np.exp(1j * (8.0 * np.pi * off_hz * t_s - phase_rad))))


def uniform_axis(t_s: FloatArray) -> tuple[float, float, NDArray[np.int64]]:
    """Return the uniform axis of some times: first time, step, and the index of each.

    The step is the median distance of different times, rounded to a millisecond.

    Parameters
    ----------
    t_s : ndarray, shape (n,)

    Examples
    --------
    >>> first_s, hop_s, index = uniform_axis(np.array([10.0, 11.0, 12.0, 15.0]))
    >>> first_s, hop_s, index.tolist()
    (10.0, 1.0, [0, 1, 2, 5])
    """
    first_s = float(t_s.min())
    steps = np.diff(np.unique(t_s))
    # Whole milliseconds, since a hop of 1 s varies a little with the frame times.
    hop_s = max(round(float(np.median(steps)), 3), 1e-3) if steps.size else 1.0
    return first_s, hop_s, np.rint((t_s - first_s) / hop_s).astype(np.int64)


def grid_of(blocks: Sequence[ReferenceBlock]) -> Grid:
    """Join blocks of one reference; what no block covers is a gap. Raises ``ValueError`` for none.

    A block that arrives twice (history for a late joiner) overwrites itself.
    """
    total = max(max(b.first + b.samples for b in blocks), max(b.total for b in blocks))
    freq = np.full(total, np.nan)
    for block in blocks:
        freq[block.first : block.first + block.samples] = block.freq_hz
    one = blocks[0]
    return Grid(one.grid, one.nominal_hz, one.t0_ns, one.step_ns / 1e9, freq, one.zone_unknown)


def to_step_of(track: Track, grid: Grid) -> Grid:
    """Average a reference with a finer step than the track's hop down to that hop.

    An average needs half of its samples. A coarser reference is returned as it is, read into
    memory: :func:`phases` thins the track instead, so that nothing is interpolated.

    Parameters
    ----------
    track : Track
    grid : Grid

    Raises
    ------
    UsageError
        If neither step is a whole multiple of the other.
    """
    if grid.step_s > track.hop_s * (1 - 1e-6):
        _whole(grid.step_s, track.hop_s)
        return replace(grid, freq_hz=np.asarray(grid.freq_hz))
    many = _whole(track.hop_s, grid.step_s)
    if many == 1:
        return replace(grid, step_s=track.hop_s, freq_hz=np.asarray(grid.freq_hz))
    return replace(grid, step_s=track.hop_s, freq_hz=means(np.asarray(grid.freq_hz), many))


def phases(track: Track, step_s: float) -> Iterator[Track]:
    """Yield a track thinned to a coarser step, once for each starting offset: no lag is lost.

    Parameters
    ----------
    track : Track
    step_s : float
        A whole multiple of the track's hop.
    """
    many = _whole(step_s, track.hop_s)
    for p in range(min(many, track.enf_hz.size)):
        yield track.part(p, slice(p, None, many), step_s)


def _whole(long_s: float, short_s: float) -> int:
    ratio = long_s / short_s
    if abs(ratio - round(ratio)) > 1e-6 * ratio:
        raise UsageError(
            f"a step of {long_s:g} s is no whole multiple of {short_s:g} s",
            "give a reference whose step divides the hop of the estimates, or the other way round",
        )
    return round(ratio)


def without_jumps(track: Track) -> tuple[Track, int]:
    """Replace the estimates that no grid can have made by holes.

    An outlier is further from the running median than both limits below.

    Returns
    -------
    track : Track
    dropped : int
        Number of outliers.
    """
    away = np.abs(track.enf_hz - _running_median(track.enf_hz, track.resolution_s / track.hop_s))
    if not np.isfinite(away).any():
        return track, 0
    scatter = 1.4826 * float(np.nanmedian(away))
    jumps = np.nan_to_num(away, nan=0.0) > max(SCATTERS * scatter, LEAST_JUMP_HZ)
    return replace(track, enf_hz=np.where(jumps, np.nan, track.enf_hz)), int(jumps.sum())


def _running_median(values: FloatArray, width: float) -> FloatArray:
    """Median of the valid values within half a width on either side; NaN if there are none."""
    half = max(round(width / 2), 1)
    padded = np.pad(values, half, constant_values=np.nan)
    ordered = np.sort(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    last = np.maximum(np.isfinite(ordered).sum(axis=1) - 1, 0)
    rows = np.arange(values.size)
    return np.asarray((ordered[rows, last // 2] + ordered[rows, (last + 1) // 2]) / 2, np.float64)
