"""Follows flicker that hardly turns from frame to frame, its alias near 0 Hz.

Model: rows are averaged in time bins, and texture and flicker separated in them jointly
(:mod:`rsenf.flicker.zero_alias`); the bins' phases, with their covariance, are observations of the
Gaussian process of :mod:`rsenf.flicker.grid_prior`. Steps that lost frames make are found and taken
off first.

Likelihood: Gaussian; the posterior mean of the process is the phase.

Approximate: the sign of the frequency's deviation depends on the read-out direction. If neither the
fit nor the size of the deviation determines it, the likelier one is taken, and the frequency about
which the other is mirrored is reported.

References
----------
- Rasmussen, C. E. and Williams, C. K. I. (2006), Gaussian Processes for Machine Learning, ch. 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.acquire import NO_FLICKER, SEARCH_HZ, may_stand_still
from rsenf.flicker.cell_light import CellLight, cell_means, still_light_of
from rsenf.flicker.frame_slips import FrameSlip, leaps
from rsenf.flicker.grid_prior import (
    FREE,
    MEAN_STD_HZ,
    MODEL_STD_HZ,
    NODES_PER_S,
    phase_prior,
    wander_of,
)
from rsenf.flicker.lines import SURE_LOG_ODDS, alias_hz, usual_log_odds
from rsenf.flicker.mains import NO_GRID, why_not
from rsenf.flicker.phase_likelihood import at_frames
from rsenf.flicker.second import FlickerSecond
from rsenf.flicker.slow_time import frame_rate
from rsenf.flicker.zero_alias import LIGHT_HZ, ZeroAlias, separate
from rsenf.flicker.zero_alias_rows import FIELD_BANDS, are_opposed, field_bands
from rsenf.medians import MEDIAN_SQUARE
from rsenf.messages import RowBlock

Float = NDArray[np.float64]
Slips = list[tuple[float, FrameSlip]]  # each with the time of the bin that it is found in

HALF = "light at the grid's own frequency, or at twice that with a strong second harmonic: which?"
# A lamp's second harmonic over its first, in the logarithm of the light, is seldom larger. If it
# is, the read-out time has to exclude a half-wave lamp by these log odds.
MOST_SECOND, LEAST_LOG_ODDS = 0.5, 3.0
FORWARD_LOG_ODDS = 2.0  # prior log odds that a camera reads its first row first
AROUND_S = 5.0  # on both sides of a bin, over which its frequency is averaged
MISFIT_S, LEAST_MISFIT = 0.5, 3.0  # margin around a second; least chi-squared that counts
# Largest mean squares of the prior's ten and forty leading directions; 1 for a grid.
MAX_WANDER, MAX_FAST = 10.0, 5.0


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Phase of the light over a span, smoothed under the grid prior.

    Attributes
    ----------
    sign : int
        1 for a read-out from the first row to the last, −1 for the reverse.
    mirror_hz : float
        Frequency about which the light's is mirrored if the read-out runs the other way; NaN where
        its direction is known.
    measured_rad : ndarray, shape (bins,)
        Phases of the bins before smoothing, relative to the nominal frequency's.
    psi_rad : ndarray, shape (nodes,)
        Smoothed phase at the nodes.
    second_var_hz2 : ndarray, shape (nodes − 4,)
        Variance of the mean frequency over the second that begins at each node.
    slips : list of tuple
        Bins in which frames are lost, how many, and the turn of all bins, as
        :func:`rsenf.flicker.frame_slips.leaps` finds them. The phases go on over them.
    """

    sign: int
    mirror_hz: float
    measured_rad: Float
    psi_rad: Float
    second_var_hz2: Float
    slips: list[tuple[int, int, Float]]


def course_of(
    found: ZeroAlias,
    nominal_hz: float,
    rate_hz: float,
    rate_std_hz: float,
    start: int,
    end: int,
    light: CellLight | None,
    unfiltered: bool,
) -> Smoothed | str:
    """Smooth the phase under the grid prior; return the reason in words if it isn't mains light.

    Parameters
    ----------
    found : ZeroAlias
    nominal_hz, rate_hz, rate_std_hz : float
        Nominal grid frequency; frame rate and its standard error, which counts since the light's
        frequency is measured relative to a multiple of the frame rate.
    start, end : int
        Seconds between which the bins lie.
    light : CellLight, optional
        Statistics of the cells, if known.
    unfiltered : bool
        Whether any of the frames were decoded without the codec's loop filter.
    """
    if abs(alias_hz(nominal_hz, rate_hz)) < SEARCH_HZ and _may_be_half(found):
        return HALF
    t_s = found.t_s
    stands_hz = rate_hz * round(2.0 * nominal_hz / rate_hz)  # alias at exactly 0 Hz
    sign, is_known = direction_of(found, stands_hz - 2.0 * nominal_hz)
    phi = sign * found.phase_rad + 2.0 * np.pi * (stands_hz - 2.0 * nominal_hz) * t_s
    grid = phase_prior((end - start) * NODES_PER_S + 1)
    prior = grid.basis
    design = np.column_stack([at_frames(t_s - start, direction) for direction in prior.T])
    noise = found.phase_cov + 1e-12 * np.eye(t_s.size)
    weighed = np.linalg.solve(noise, design)
    precision = design.T @ weighed + np.eye(prior.shape[1])
    coefficient = np.linalg.solve(precision, weighed.T @ (phi - phi.mean()))
    off_hz = 2.0 * nominal_hz - stands_hz + _off_hz(prior @ coefficient, t_s - start, end - start)
    # A frame that is lost unseen turns the light by a frame period's worth.
    step_rad = 2.0 * np.pi * off_hz / rate_hz
    residual = phi - phi.mean() - design @ coefficient
    spread = max(float(np.median(residual**2 / np.diag(noise))) / MEDIAN_SQUARE, 1.0)
    slips = leaps(phi - phi.mean(), spread * noise + design @ design.T, step_rad)
    phi = phi - sum(turned for _, _, turned in slips)
    coefficient = np.asarray(np.linalg.solve(precision, weighed.T @ (phi - phi.mean())), np.float64)
    mean_hz, moves = coefficient[1] * MEAN_STD_HZ, coefficient[FREE:] ** 2
    if moves[:10].mean() > MAX_WANDER or moves[:40].mean() > MAX_FAST:
        return NO_GRID
    wander = wander_of(coefficient, precision, len(prior))
    f0_hz = 2.0 * nominal_hz + mean_hz
    if why := why_not(f0_hz, nominal_hz, rate_hz, wander, light, unfiltered=unfiltered):
        return why
    variance = grid.second_var_hz2(np.asarray(np.linalg.inv(precision), np.float64))
    variance *= _misfit(t_s - start, phi - phi.mean() - design @ coefficient, noise, variance.size)
    variance += (stands_hz / rate_hz * rate_std_hz) ** 2
    psi = prior @ coefficient + phi.mean()
    return Smoothed(sign, np.nan if is_known else stands_hz, phi, psi, variance, slips)


def _off_hz(psi_rad: Float, t_s: Float, length_s: float) -> Float:
    """Mean frequency of a phase at nodes, relative to the nominal, around each time."""
    ends_s = np.clip(t_s + np.array([[-AROUND_S], [AROUND_S]]), 0.0, length_s)
    turned = np.diff(at_frames(ends_s, psi_rad), axis=0)[0]
    return np.asarray(turned / (2.0 * np.pi * (ends_s[1] - ends_s[0])))


def _may_be_half(found: ZeroAlias) -> bool:
    """Whether light at half the frequency may make the same ramp, in twice the read-out time."""
    by_ramp_s = found.turns / LIGHT_HZ
    off = (abs(found.read_out_s) - by_ramp_s * np.array([1.0, 2.0])) / found.read_out_std
    log_odds = float(off[1] ** 2 - off[0] ** 2) / 2.0
    is_unusual = found.series.size > 1 and abs(found.series[1]) > MOST_SECOND * found.amplitude
    return log_odds < (LEAST_LOG_ODDS if is_unusual else -LEAST_LOG_ODDS)


def _misfit(t_s: Float, residual_rad: Float, noise: Float, nodes: int) -> Float:
    """Reduced chi-squared of the bins around each second that begins at a node; 1 unless large.

    A lost frame that the time stamps don't show makes a step that no smooth course fits.
    """
    excess = residual_rad**2 / np.diag(noise)
    begins_s = np.arange(nodes)[:, None] / NODES_PER_S
    near = (t_s > begins_s - MISFIT_S) & (t_s < begins_s + 1.0 + MISFIT_S)
    chi2 = near @ excess / np.maximum(near.sum(axis=1), 1)
    return np.where(chi2 > LEAST_MISFIT, chi2, 1.0)


def direction_of(found: ZeroAlias, stands_off_hz: float) -> tuple[int, bool]:
    """Read-out direction, from the fit or from which deviation is the more usual.

    Parameters
    ----------
    found : ZeroAlias
    stands_off_hz : float
        Deviation from the nominal frequency at which the alias is exactly 0 Hz.

    Returns
    -------
    sign : int
        1 from the first row to the last, −1 the reverse: the likelier one.
    is_known : bool
    """
    if found.direction:
        return found.direction, True
    slope_hz = float(np.polyfit(found.t_s, found.phase_rad, 1)[0]) / (2.0 * np.pi)
    forward, reverse = stands_off_hz + slope_hz, stands_off_hz - slope_hz
    log_odds = usual_log_odds(forward, reverse)
    return (1 if log_odds + FORWARD_LOG_ODDS > 0.0 else -1), abs(log_odds) > SURE_LOG_ODDS


SPAN_S = 120  # longest span that is separated
SHORTEST_S = 20
EVERY_S = 15
ANEW = 8  # spans after which the flicker is searched for from the start again
BINS_PER_S = 4
BANDS = 120
TOO_STILL = "alias at 0 Hz, and the flicker's phase has turned too little to tell it from texture"
FIELDS = (
    "interlaced: even rows and odd ones are taken half a period of the light apart, so that what "
    "is left of it in both is its second harmonic"
)


class NearDcTracker:
    """Averages rows in time bins, and tracks the phase of the flicker in them.

    Parameters
    ----------
    nominal_hz : float
        Nominal frequency of the grid whose alias is near 0 Hz.
    """

    def __init__(self, nominal_hz: float) -> None:
        self.nominal_hz = nominal_hz
        # Sums per bin: rows, fields, cells; frames without loop filter; time, number, all frames.
        self._sum: dict[int, Float] = {}
        self._fine = self._bands = 0  # bands of rows, and of cells
        self._path: _Path | None = None
        self._before: ZeroAlias | None = None  # of the last span, as long as its flicker goes on
        self._looks = 0
        self._source_hz = 0.0  # original frame rate, if the stream was converted
        self.why = NO_FLICKER

    def of_source(self, source_hz: float, nominals_hz: tuple[float, ...]) -> NearDcTracker | None:
        """Return the tracker for a stream converted from this rate; None if no alias is near 0."""
        for nominal_hz in nominals_hz:
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
        columns = np.hstack([bands, field_bands(profile), cells.reshape(block.frames, -1)])
        for t, number, rows in zip(t_s.tolist(), block.frame_number.tolist(), columns, strict=True):
            k = int(t * BINS_PER_S)
            terms = np.concatenate([rows, [bool(block.effort), t, number, 1.0]])
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
        self._looks += 1
        found = separate(rows, t_s, frames, self._before if self._looks % ANEW else None)
        self._before = None
        if found is None or not found.is_flicker:
            self.why = NO_FLICKER
            return False
        fields, cells = np.split(sums[:, self._fine : -4] / frames[:, None], [2 * FIELD_BANDS], 1)
        if not found.determined or are_opposed(rows, fields):
            self.why = FIELDS if found.determined else TOO_STILL
            return False
        rate_hz, rate_std_hz = frame_rate(t_s, numbers)
        if self._source_hz:
            rate_hz, rate_std_hz = self._source_hz, 0.0
        level = float(np.mean(found.texture(rows, frames)))
        light = still_light_of(cells, t_s, found.phase_rad, self._bands, abs(found.turns) + 1.0)
        unfiltered = bool(sums[:, -4].any())
        course = course_of(
            found, self.nominal_hz, rate_hz, rate_std_hz, start, end, light, unfiltered
        )
        if isinstance(course, str):
            self.why = course
            return False
        firsts = np.ceil(numbers - (frames - 1.0) / 2.0).astype(int).tolist()
        slips = [(t_s[at], FrameSlip(firsts[at], lost)) for at, lost, _ in course.slips]
        self._path = _path(found, course, start, level, self._path, slips)
        self._before = found
        return True

    @property
    def level(self) -> float:
        """Amplitude of the flicker in the last span, in levels; 0 if none is known."""
        return self._path.size if self._path else 0.0

    @property
    def knows_direction(self) -> bool:
        """Whether the last span determined the read-out direction."""
        return self._path is not None and bool(np.isnan(self._path.mirror_hz))

    def second(self, blank: FlickerSecond, frame_t_s: Float) -> FlickerSecond:
        """Fill in one second of the last span, whose frames have these times."""
        path = self._path
        assert path is not None
        blank = replace(blank, nominal_hz=self.nominal_hz, turns=path.turns, snr_db=path.snr_db)
        node = (blank.index - path.start) * NODES_PER_S
        inside = (path.t_s >= blank.index) & (path.t_s < blank.index + 1)
        if not 0 <= node < path.second_var_hz2.size or not inside.any():
            return replace(blank, reason="too few frames are usable")
        psi = path.psi_rad
        turned = float(psi[node + NODES_PER_S] - psi[node]) / (2.0 * np.pi)
        bins = at_frames(path.t_s[inside] - path.start, psi)
        beyond = np.mean(np.exp(1j * (path.measured_rad[inside] - bins)))
        slips = tuple(s for t, s in path.slips if blank.index <= t < blank.index + 1)
        return replace(
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


@dataclass(frozen=True, eq=False)
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
    slips: Slips
    leaps: list[tuple[float, float]]  # of the phase: when, and by how much (rad)


def _path(
    found: ZeroAlias, course: Smoothed, start: int, level: float, before: _Path | None, slips: Slips
) -> _Path:
    """Phase path of a span, unwrapped to continue that of an earlier one."""
    turn, psi = 0.0, course.psi_rad
    if before is not None:
        overlap = before.psi_rad[(start - before.start) * NODES_PER_S :][: psi.size]
        apart = float(np.median(overlap - psi[: overlap.size])) if overlap.size else 0.0
        turn = 2.0 * np.pi * round(apart / (2.0 * np.pi))
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
