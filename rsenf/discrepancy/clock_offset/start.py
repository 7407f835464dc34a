"""Locates a clip in a reference, and finds whether the reference is an average over a window."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from rsenf.discrepancy.clock_offset.clip import FEWEST_BLOCKS, MARGIN_S, AlignedReference, EnfClip
from rsenf.errors import InputError, NoSignal
from rsenf.match import Match, MatchSettings
from rsenf.match.clip_phase import AVERAGED_S, average, window_kernel
from rsenf.match.series import Grid, track_of
from rsenf.messages import EnfEstimate, MatchResult
from rsenf.messages.schema import FloatArray

# Prior scale of a wrong frame rate: 29.97 frames per second taken for 30 are 1000 ppm.
ANY_SPEED_PPM = 1000.0
LEAST_LOG10_LR = 2.0  # against other lags, for a lag to be tried
LEAST_COVERED = 0.5  # share of the estimates that a reference must cover
AROUND_S = 600.0  # part of a reference kept on either side of a clip
WINDOW_STEPS = 2  # Gauss-Newton steps to the window of an average
LEAST_VALUES = 20  # that a step is taken from
PIECE = 1 << 20  # samples examined at once
MOST_BEYOND_S = MARGIN_S / 2.0  # uncovered part of a clip, less than the margin as the lag may move


def beside_of(clip: EnfClip, grid: Grid) -> AlignedReference:
    """Locate a clip in a reference and align both.

    Parameters
    ----------
    clip : EnfClip
    grid : Grid
        The reference.

    Raises
    ------
    InputError
        When the clip has no usable ENF, isn't found in the reference, or is too short.
    """
    usable = [e for e in clip.estimates if e.usable]
    if not usable:
        why = clip.estimates[0].reason if clip.estimates else "shorter than one window"
        raise NoSignal(f"no ENF to compare with the reference: {why}", "see rsenf track")
    _check_grid(usable, grid)
    known = [e.snr_db for e in usable if np.isfinite(e.snr_db)]
    snr_db = float(np.median(known)) if known else float("nan")
    lag_s, certain = _place(clip.estimates, grid)
    _check_covered(clip, grid, lag_s)
    grid, begins_s = _about(clip, grid, lag_s)
    track, lag_s = track_of(clip.estimates), lag_s - begins_s
    beside = AlignedReference(clip, track, snr_db, grid, lag_s, begins_s, certain)
    if beside.blocks < FEWEST_BLOCKS:
        needed_s = FEWEST_BLOCKS * beside.block_s + 2.0 * beside.reach_s
        raise InputError(
            f"too short to be compared with this reference: {clip.duration_s:.0f} s",
            f"{needed_s:.0f} s are the least that is of use",
        )
    return beside


def _check_grid(usable: Sequence[EnfEstimate], grid: Grid) -> None:
    """Refuse a reference that is constant or of another nominal frequency."""
    starts = range(0, len(grid.freq_hz), PIECE)
    pieces = (np.asarray(grid.freq_hz[start : start + PIECE]) for start in starts)
    if not any(np.isfinite(of).any() and np.nanstd(of) > 0.0 for of in pieces):
        raise InputError(f"the reference {grid.name} doesn't move", "give one that was measured")
    if round(usable[0].nominal_hz) != round(grid.nominal_hz):
        raise InputError(
            f"the light follows a {usable[0].nominal_hz:.0f} Hz grid, {grid.name} is of a "
            f"{grid.nominal_hz:.0f} Hz one",
            "give a reference of the grid that fed the lamp",
        )


def _about(clip: EnfClip, grid: Grid, lag_s: float) -> tuple[Grid, float]:
    """Return the part of a reference about a clip, and its start: references may be years long."""
    first = max(int((lag_s - AROUND_S) / grid.step_s), 0)
    last = int((lag_s + clip.duration_s + AROUND_S) / grid.step_s)
    near = dataclasses.replace(grid, freq_hz=np.asarray(grid.freq_hz[first:last]))
    return near, first * grid.step_s


def _check_covered(clip: EnfClip, grid: Grid, lag_s: float) -> None:
    """Refuse a reference that covers too little of a clip."""
    end_s = lag_s + clip.duration_s
    covered_s = min(end_s, len(grid.freq_hz) * grid.step_s) - max(lag_s, 0.0)
    if clip.duration_s - covered_s > min(MOST_BEYOND_S, LEAST_COVERED * clip.duration_s):
        raise InputError(
            f"the reference {grid.name} covers only {max(covered_s, 0.0):.0f} of "
            f"{clip.duration_s:.0f} seconds of the clip",
            "give one that covers all of it",
        )


def _place(estimates: Sequence[EnfEstimate], grid: Grid) -> tuple[float, bool]:
    """Return the lag of a clip, and whether it is certain before anything is fitted.

    First by phase, with the clock errors of cameras, then with those of wrong frame rates; at last
    by correlation of the frequency, which tolerates a rougher reference, but can't tell whether the
    true time is in the reference at all.
    """
    for settings in (MatchSettings(), MatchSettings(clock_scale_ppm=ANY_SPEED_PPM)):
        by_phase = _found(estimates, grid, "phase", settings)
        if by_phase.decision == "match":
            return by_phase.lag_s, True
    by_frequency = _found(estimates, grid, "ncc", MatchSettings())
    if by_frequency.log10_lr >= LEAST_LOG10_LR:
        return by_frequency.lag_s, by_frequency.decision == "match"
    raise no_match(grid, by_phase.reason)


def no_match(grid: Grid, reason: str) -> InputError:
    """Return the error for a clip that isn't found in a reference."""
    return InputError(
        f"no match in the reference {grid.name}: {reason}",
        "give the grid's log of the time of the recording; rsenf verify tells more",
    )


def _found(
    estimates: Sequence[EnfEstimate], grid: Grid, method: str, settings: MatchSettings
) -> MatchResult:
    match = Match(method=method, grids=[grid], settings=settings)
    for estimate in estimates:
        match.update(estimate)
    result: MatchResult = match.flush()[0]
    return result


def read_aright(beside: AlignedReference, said_hz: FloatArray) -> AlignedReference:
    """Choose whether to take the reference for an average, by the smaller residual, and its window.

    Both alternatives are averaged alike, so that they can be compared.

    Parameters
    ----------
    beside : AlignedReference
    said_hz : ndarray (n,)
        Predicted ENF.

    Raises
    ------
    InputError
        When the reference covers too little of the clip.
    """
    both = np.isfinite(said_hz) & np.isfinite(beside.enf_hz)
    if both.sum() < LEAST_COVERED * beside.track.usable:
        raise InputError(
            f"the reference {beside.grid.name} covers only {both.sum()} of "
            f"{beside.track.usable} seconds of the clip",
            "give one that covers all of it",
        )
    other = dataclasses.replace(beside, averaged_s=AVERAGED_S)
    if other.blocks < FEWEST_BLOCKS:
        return beside
    weights = window_kernel(AVERAGED_S, beside.track.hop_s)
    once, twice = other.enf_hz - said_hz, other.enf_hz - average(said_hz, weights)
    known = np.isfinite(once + twice)
    if once[known].var() >= twice[known].var():
        return beside
    for _ in range(WINDOW_STEPS):
        better = dataclasses.replace(beside, averaged_s=_window_s(other, said_hz))
        if better.blocks < FEWEST_BLOCKS:  # too short for so wide a window
            break
        other = better
    return other


def _window_s(beside: AlignedReference, said_hz: FloatArray) -> float:
    """Return a better length of the window over which a reference is an average.

    A wider window adds ``½ σ² f″`` to an average ``f``, to second order, where ``σ²`` is by how
    much the variance of its weights is larger: one Gauss-Newton step from the present length, on
    the training blocks, away from gaps.
    """
    hop_s = beside.track.hop_s
    weights = window_kernel(beside.averaged_s, hop_s)
    bend = 0.5 * np.gradient(np.gradient(beside.enf_hz, hop_s), hop_s)
    here = beside.training & np.isfinite(said_hz + bend)
    if here.sum() < LEAST_VALUES:
        return beside.averaged_s
    columns = np.column_stack([bend[here], np.ones(here.sum())])
    more_s2 = float(np.linalg.lstsq(columns, (said_hz - beside.enf_hz)[here], rcond=None)[0][0])
    reach = weights.size // 2
    var_s2 = float(weights @ (np.arange(-reach, reach + 1) * hop_s) ** 2)
    ratio = np.sqrt(max(1.0 + more_s2 / var_s2, 0.0))
    return float(np.clip(beside.averaged_s * ratio, AVERAGED_S / 2.0, 2.0 * AVERAGED_S))
