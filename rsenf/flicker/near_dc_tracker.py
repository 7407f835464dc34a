"""Tracker near 0 Hz: follows flicker that hardly turns from frame to frame.

Where the alias is at or near 0 Hz, texture and flicker are separated jointly over as long a span as
available (:mod:`rsenf.flicker.zero_alias`). Here its phases, smoothed under the grid prior
(:mod:`rsenf.flicker.near_dc_course`), are cut into seconds.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import SEARCH_HZ
from rsenf.flicker.cell_light import cell_means, still_light_of
from rsenf.flicker.frame_slips import FrameSlip
from rsenf.flicker.grid_prior import NODES_PER_S
from rsenf.flicker.lines import alias_hz
from rsenf.flicker.near_dc_course import Course, course_of
from rsenf.flicker.node_sums import at_frames
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.zero_alias import MIN_ROWS, ZeroAlias, separate
from rsenf.messages import RowBlock

Float = NDArray[np.float64]

SPAN_S = 120  # longest span that is separated
SHORTEST_S = 20
EVERY_S = 15
BINS_PER_S = 4
BANDS = 120
FIELD_BANDS = 24  # bands in which even and odd rows are compared
TOO_STILL = "alias at 0 Hz, and the flicker's phase has turned too little to tell it from texture"
NOT_FLICKER = "no mains flicker stands out"
FIELDS = (
    "interlaced: even rows and odd ones are taken half a period of the light apart, so that what "
    "is left of it in both is its second harmonic"
)
MODEL_STD_HZ = 4e-5
HOLE_FRAMES = 0.5  # difference of time and numbers, from bin to bin, at missing frames
MOST_STRETCHES = 0.2  # per bin: gaps are few
MOST_ALIKE = 0.98  # correlation of neighbouring bins' times


def may_stand_still(nominal_hz: float, frame_rate_hz: float, rows: int) -> bool:
    """Whether the alias's search band includes 0 Hz, with enough rows for a ramp.

    Parameters
    ----------
    nominal_hz, frame_rate_hz : float
    rows : int
    """
    return rows >= MIN_ROWS and abs(alias_hz(2.0 * nominal_hz, frame_rate_hz)) < SEARCH_HZ


class NearDcTracker:
    """Averages rows in time bins, and tracks the phase of the flicker in them.

    Parameters
    ----------
    nominal_hz : float
        Nominal frequency of the grid whose alias is near 0 Hz.
    """

    def __init__(self, nominal_hz: float) -> None:
        self.nominal_hz = nominal_hz
        # Sums per bin: rows, fields, cells, then time, frame number and number of frames.
        self._sum: dict[int, Float] = {}
        self._fine = self._bands = 0  # bands of rows, and of cells
        self._path: _Path | None = None
        self._source_hz = 0.0  # original frame rate, if the stream was converted
        self.why = NOT_FLICKER

    def of_source(self, source_hz: float) -> NearDcTracker | None:
        """Return the tracker for a stream converted from this rate; None if no alias is near 0."""
        for nominal_hz in (50.0, 60.0):
            if self._fine and may_stand_still(nominal_hz, source_hz, self._fine):
                self.nominal_hz, self._source_hz = nominal_hz, source_hz
                return self
        return None

    def add(self, block: RowBlock, origin_ns: int) -> None:
        """Add a block of rows, frame by frame."""
        if not block.usable:
            return
        t_s = (block.frame_pts_ns - origin_ns) / 1e9
        edges = np.unique(np.linspace(0, block.rows, min(block.rows, BANDS) + 1).astype(int))
        profile = block.profiles()
        bands = np.add.reduceat(profile, edges[:-1], axis=1) / np.diff(edges)
        self._fine, cells = edges.size - 1, cell_means(block.level)
        self._bands = cells.shape[1]
        columns = np.hstack([bands, _fields(profile), cells.reshape(block.frames, -1)])
        for t, number, rows in zip(t_s.tolist(), block.frame_number.tolist(), columns, strict=True):
            k = int(t * BINS_PER_S)
            terms = np.concatenate([rows, [t, number, 1.0]])
            self._sum[k] = self._sum[k] + terms if k in self._sum else terms

    def forget_before(self, second: int) -> None:
        """Drop the bins before a second."""
        for k in [k for k in self._sum if k < second * BINS_PER_S]:
            del self._sum[k]

    def look(self, end: int) -> bool:
        """Separate texture and flicker before second ``end``; return whether the phase is known."""
        start = max(end - SPAN_S, min(self._sum, default=0) // BINS_PER_S)
        keys = sorted(k for k in self._sum if start * BINS_PER_S <= k < end * BINS_PER_S)
        if len(keys) < SHORTEST_S * BINS_PER_S // 2:
            self.why = "too few frames are usable"
            return False
        sums = np.array([self._sum[k] for k in keys])
        frames = sums[:, -1]
        t_s, numbers = sums[:, -3] / frames, sums[:, -2] / frames
        rows = sums[:, : self._fine] / frames[:, None]
        found = separate(rows, t_s, frames)
        if found is None or not found.is_flicker:
            self.why = NOT_FLICKER
            return False
        fields, cells = np.split(sums[:, self._fine : -3] / frames[:, None], [2 * FIELD_BANDS], 1)
        if not found.determined:
            self.why = TOO_STILL
            return False
        if _are_opposed(rows, fields):
            self.why = FIELDS
            return False
        rate_hz, rate_std_hz = frame_rate(t_s, numbers)
        if self._source_hz:
            rate_hz, rate_std_hz = self._source_hz, 0.0
        level = float(np.mean(found.texture(rows, frames)))
        turns = abs(found.turns) + 1.0
        light = still_light_of(cells, t_s, found.phase_rad, self._bands, turns)
        course = course_of(found, self.nominal_hz, rate_hz, rate_std_hz, start, end, light)
        if isinstance(course, str):
            self.why = course
            return False
        firsts = np.ceil(numbers - (frames - 1.0) / 2.0).astype(int).tolist()
        slips = [(t_s[at], FrameSlip(firsts[at], lost)) for at, lost, _ in course.slips]
        self._path = _path(found, course, start, level, self._path, slips)
        return True

    @property
    def knows_direction(self) -> bool:
        """Whether the last span determined the read-out direction."""
        return self._path is not None and bool(np.isnan(self._path.mirror_hz))

    def second(self, blank: FlickerSecond, frame_t_s: Float) -> FlickerSecond:
        """Fill in one second of the last span, whose frames have these times."""
        path = self._path
        assert path is not None
        blank = dataclasses.replace(
            blank, nominal_hz=self.nominal_hz, turns=path.turns, snr_db=path.snr_db
        )
        node = (blank.index - path.start) * NODES_PER_S
        inside = (path.t_s >= blank.index) & (path.t_s < blank.index + 1)
        if not 0 <= node < path.second_var_hz2.size or not inside.any():
            return dataclasses.replace(blank, reason="too few frames are usable")
        psi = path.psi_rad
        turned = float(psi[node + NODES_PER_S] - psi[node]) / (2.0 * np.pi)
        bins = at_frames(path.t_s[inside] - path.start, psi)
        beyond = np.mean(np.exp(1j * (path.measured_rad[inside] - bins)))
        slips = tuple(s for t, s in path.slips if blank.index <= t < blank.index + 1)
        return dataclasses.replace(
            blank,
            usable=True,
            reason="",
            slips=slips,
            f0_hz=2.0 * self.nominal_hz + turned,
            f0_var_hz2=float(path.second_var_hz2[node]) + MODEL_STD_HZ**2,
            mirror_hz=path.mirror_hz,
            phase_rad=4.0 * np.pi * self.nominal_hz * frame_t_s
            + at_frames(frame_t_s - path.start, psi)
            + sum((rad * (frame_t_s >= t) for t, rad in path.leaps), np.zeros_like(frame_t_s)),
            amplitude=complex(path.size * np.exp(1j * psi[node + NODES_PER_S // 2]) * beyond),
            amplitude_var=float(path.size**2 * np.mean(path.measured_var[inside]) / inside.sum()),
        )


def _fields(profile: Float) -> Float:
    """Levels of even rows, and even less odd rows, in bands side by side."""
    pairs = profile[:, : profile.shape[1] // 2 * 2].reshape(len(profile), -1, 2)
    edges = np.linspace(0, pairs.shape[1], FIELD_BANDS, endpoint=False).astype(int)
    level, less = pairs[:, :, 0], pairs[:, :, 0] - pairs[:, :, 1]
    return np.hstack([np.add.reduceat(level, edges, 1), np.add.reduceat(less, edges, 1)])


def _are_opposed(rows: Float, fields: Float) -> bool:
    """Whether even and odd rows differ by more slow variation than they have in common."""
    level, less = np.split(fields, 2, axis=1)
    logs = np.log(np.maximum(rows, 1.0))
    apart = less / np.maximum(level, 1.0)
    return _slow_power(apart) > _slow_power(logs - logs.mean(axis=1, keepdims=True))


def _slow_power(series: Float) -> float:
    """Variance over time less that of the noise, from differences of neighbouring bins."""
    return float(np.mean(np.var(series, axis=0)) - np.mean(np.diff(series, axis=0) ** 2) / 2.0)


def frame_rate(t_s: Float, numbers: Float) -> tuple[float, float]:
    """Frame rate and its standard error, from parallel lines through stretches without gaps.

    Sources don't number frames that they never received: across a gap time advances, but numbers
    don't.

    Parameters
    ----------
    t_s, numbers : ndarray, shape (bins,)
        Mean time and mean frame number of each bin.
    """
    step_s, step = np.diff(t_s), np.diff(numbers)
    usual_hz = float(np.median(step / step_s))
    holes = np.abs(step - usual_hz * step_s) > HOLE_FRAMES
    stretch = np.concatenate([[0], np.cumsum(holes)])
    count = np.bincount(stretch)
    t, n = (x - (np.bincount(stretch, x) / count)[stretch] for x in (t_s, numbers))
    square = float(t @ t)
    if not square > 0.0:
        return usual_hz, np.inf
    rate_hz = float(t @ n) / square
    residual = n - rate_hz * t
    var = float(residual @ residual) / max(t.size - count.size - 1, 1)
    if var > HOLE_FRAMES**2 or count.size > MOST_STRETCHES * t.size:
        return rate_hz, np.inf  # the rate varies
    # With a slowly varying rate residuals are correlated (AR(1)): fewer effective samples.
    alike = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-30)
    alike = min(max(alike, 0.0), MOST_ALIKE)
    return rate_hz, float(np.sqrt(var / square * (1.0 + alike) / (1.0 - alike)))


@dataclasses.dataclass(frozen=True, eq=False)
class _Path:
    start: int
    turns: float
    mirror_hz: float
    snr_db: float
    size: float  # levels
    psi_rad: Float  # at nodes, relative to the nominal frequency's
    second_var_hz2: Float
    t_s: Float  # of the bins
    measured_rad: Float  # their phases before smoothing
    measured_var: Float
    slips: list[tuple[float, FrameSlip]]  # and the time of the bin that they are found in
    leaps: list[tuple[float, float]]  # of the phase: when, and by how much (rad)


def _path(
    found: ZeroAlias,
    course: Course,
    start: int,
    level: float,
    before: _Path | None,
    slips: list[tuple[float, FrameSlip]],
) -> _Path:
    """Phase path of a span, unwrapped to continue that of an earlier one."""
    turn, psi = 0.0, course.psi_rad
    if before is not None:
        turn = 2.0 * np.pi * round(_apart(before, psi, start) / (2.0 * np.pi))
    snr = (found.amplitude / found.amplitude_std) ** 2 / 2.0
    return _Path(
        start=start,
        turns=course.sign * found.turns,
        mirror_hz=course.mirror_hz,
        snr_db=float(10.0 * np.log10(snr)),
        size=found.amplitude * level,
        psi_rad=psi + turn,
        second_var_hz2=course.second_var_hz2,
        t_s=found.t_s,
        measured_rad=course.measured_rad + turn,
        measured_var=np.diag(found.phase_cov),
        slips=slips,
        leaps=[(float(found.t_s[at]), float(turned[-1])) for at, _, turned in course.slips],
    )


def _apart(before: _Path, psi: Float, start: int) -> float:
    """Median phase difference of an earlier path from a later one where they overlap."""
    skip = (start - before.start) * NODES_PER_S
    old = before.psi_rad[skip:]
    return float(np.median(old[: psi.size] - psi[: old.size])) if old.size else 0.0
