"""The two things compared, each on one uniform axis with holes: a clip's ENF and a reference."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.match.estimates import Rows, rows_of
from rsenf.messages import EnfEstimate, ReferenceBlock
from rsenf.messages.schema import FloatArray

# Where two times of a grid differ, they do so for about this long.
GRID_MEMORY_S = 20.0


@dataclass(frozen=True, eq=False)
class Track:
    """ENF estimates of one clip, value ``i`` centred at ``first_s + i·hop_s`` from its start.

    ``enf_hz`` (n,) is NaN where there is no usable estimate; ``var_hz2`` (n,) is the estimates'
    own variance about the grid's 1 s mean. ``phase_rad`` (n,) is the illumination's phase in the
    middle of each window less that of twice the nominal frequency, between −π and π, and
    ``phase_var_rad2`` (n,) its variance; NaN where an estimate brings none. ``mirror_hz`` is the
    frequency about which all of it is mirrored if the read-out runs the other way than assumed; NaN
    where its direction is known. ``alternatives`` is how many tracks of the same clip, by other
    assumptions, are compared for this one.
    """

    first_s: float
    hop_s: float
    window_s: float
    enf_hz: FloatArray
    var_hz2: FloatArray
    nominal_hz: float
    phase_rad: FloatArray = field(default_factory=lambda: np.empty(0))
    phase_var_rad2: FloatArray = field(default_factory=lambda: np.empty(0))
    mirror_hz: float = float("nan")
    alternatives: int = 1

    def __post_init__(self) -> None:
        if not self.phase_rad.size:
            nothing = np.full(self.enf_hz.size, np.nan)
            object.__setattr__(self, "phase_rad", nothing)
            object.__setattr__(self, "phase_var_rad2", nothing)

    @property
    def usable(self) -> int:
        """How many values there are."""
        return int(np.isfinite(self.enf_hz).sum())

    @property
    def directions(self) -> int:
        """How many directions of read-out there are to compare."""
        return 1 if math.isnan(self.mirror_hz) else 2

    @property
    def hypotheses(self) -> int:
        """How many tracks are searched for where one is right."""
        return self.directions * self.alternatives

    def between(self, first: int, last: int) -> Track:
        """Return some of its values, on the same clock."""
        own = slice(first, last)
        return replace(
            self,
            first_s=self.first_s + first * self.hop_s,
            enf_hz=self.enf_hz[own],
            var_hz2=self.var_hz2[own],
            phase_rad=self.phase_rad[own],
            phase_var_rad2=self.phase_var_rad2[own],
        )

    def mirrored(self) -> Track:
        """Return what the estimates are if the read-out runs the other way."""
        t_s = self.first_s + self.hop_s * np.arange(self.enf_hz.size, dtype=np.float64)
        return replace(
            self,
            enf_hz=2.0 * self.mirror_hz - self.enf_hz,
            phase_rad=_mirrored_phase(self.phase_rad, t_s, self.mirror_hz - self.nominal_hz),
        )

    @property
    def resolution_s(self) -> float:
        """Time over which residuals at a lag hang together: the window's, or the grid's own."""
        return max(self.window_s, GRID_MEMORY_S)


@dataclass(frozen=True, eq=False)
class Grid:
    """A reference: sample ``k`` is the mean over ``[k, k + 1)·step_s`` from its start.

    ``freq_hz`` (n,) is NaN in gaps; ``t0_ns`` is UTC since 1970 or 0 for unknown, and off by whole
    hours perhaps where the zone of its times is unknown.
    """

    name: str
    nominal_hz: float
    t0_ns: int
    step_s: float
    freq_hz: FloatArray
    zone_unknown: bool = False

    @property
    def duration_s(self) -> float:
        """From the first sample's start to the last one's end."""
        return self.freq_hz.size * self.step_s


def track_of(estimates: Sequence[EnfEstimate]) -> Track:
    """Put estimates on their uniform axis; a missing or unusable one leaves a hole.

    The hop is the smallest usual distance of two estimates. Raises ``ValueError`` without any.
    """
    return track_of_rows(rows_of(estimates))


def track_of_rows(rows: Rows) -> Track:
    """Do the same with estimates that were kept."""
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
    """Mirror the estimates for which the other direction of read-out was assumed.

    The other direction than that of those that know it, or than that of most.
    """
    good = rows["usable"] & np.isfinite(rows["enf_hz"])
    is_assumed = good & np.isfinite(rows["mirror_hz"])
    if not is_assumed.any():
        return rows
    telling = good & ~is_assumed if (good & ~is_assumed).any() else good
    is_reverse = 2 * np.count_nonzero(rows["is_reverse"][telling]) > np.count_nonzero(telling)
    wrong = is_assumed & (rows["is_reverse"] != is_reverse)
    rows = rows.copy()
    own = rows[wrong]
    rows["enf_hz"][wrong] = 2.0 * own["mirror_hz"] - own["enf_hz"]
    rows["phase_rad"][wrong] = _mirrored_phase(
        own["phase_rad"], own["t_s"], own["mirror_hz"] - own["nominal_hz"]
    )
    return rows


def _mirrored_phase(
    phase_rad: FloatArray, t_s: FloatArray, off_hz: FloatArray | float
) -> FloatArray:
    """Illumination's phase less the nominal's, mirrored about that of a frequency off the nominal.

    ``off_hz`` is of the grid; the illumination turns twice as fast.
    """
    return np.asarray(np.angle(np.exp(1j * (8.0 * np.pi * off_hz * t_s - phase_rad))))


def uniform_axis(t_s: FloatArray) -> tuple[float, float, NDArray[np.int64]]:
    """Find the uniform axis that times lie on: its first time, its step, and the place of each.

    The step is the usual distance of two different times.
    """
    first_s = float(t_s.min())
    steps = np.diff(np.unique(t_s))
    # Whole milliseconds: frame times make a hop of one second a little uneven.
    hop_s = max(round(float(np.median(steps)), 3), 1e-3) if steps.size else 1.0
    return first_s, hop_s, np.rint((t_s - first_s) / hop_s).astype(np.int64)


def grid_of(blocks: Sequence[ReferenceBlock]) -> Grid:
    """Join blocks of one reference; what no block covers is a gap. Raises ``ValueError`` without.

    A block that comes again (a late joiner's history) overwrites itself.
    """
    total = max(max(b.first + b.samples for b in blocks), max(b.total for b in blocks))
    freq = np.full(total, np.nan)
    for block in blocks:
        freq[block.first : block.first + block.samples] = block.freq_hz
    one = blocks[0]
    return Grid(one.grid, one.nominal_hz, one.t0_ns, one.step_ns / 1e9, freq, one.zone_unknown)


def to_step_of(track: Track, grid: Grid) -> Grid:
    """Average a reference that is finer than the track down to the track's hop.

    An average needs half of its samples. A coarser reference is returned as it is, all of it read
    where it was stored: :func:`phases` thins the track instead, so that nothing is interpolated.

    Raises
    ------
    UsageError
        When neither step is a whole multiple of the other.
    """
    if grid.step_s > track.hop_s * (1 - 1e-6):
        _whole(grid.step_s, track.hop_s)
        return replace(grid, freq_hz=np.asarray(grid.freq_hz))
    many = _whole(track.hop_s, grid.step_s)
    rows = grid.freq_hz[: grid.freq_hz.size // many * many].reshape(-1, many)
    ok = np.isfinite(rows)
    count = ok.sum(axis=1)
    mean = np.where(ok, rows, 0.0).sum(axis=1) / np.maximum(count, 1)
    return replace(grid, step_s=track.hop_s, freq_hz=np.where(2 * count >= many, mean, np.nan))


def phases(track: Track, step_s: float) -> Iterator[Track]:
    """Thin a track to a coarser step, once for every phase, so that no lag is left out."""
    many = _whole(step_s, track.hop_s)
    for p in range(min(many, track.enf_hz.size)):
        yield replace(
            track,
            first_s=track.first_s + p * track.hop_s,
            hop_s=step_s,
            enf_hz=track.enf_hz[p::many],
            var_hz2=track.var_hz2[p::many],
            phase_rad=track.phase_rad[p::many],
            phase_var_rad2=track.phase_var_rad2[p::many],
        )


def _whole(long_s: float, short_s: float) -> int:
    ratio = long_s / short_s
    if abs(ratio - round(ratio)) > 1e-6 * ratio:
        raise UsageError(
            f"a step of {long_s:g} s is no whole multiple of {short_s:g} s",
            "give a reference whose step divides the hop of the estimates, or the other way round",
        )
    return round(ratio)
