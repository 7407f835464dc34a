"""Compares recordings with each other: were they made at the same time, and how far apart?

The longer recording serves as the reference: its estimates are the samples of the grid frequency,
with their own errors. The phase matcher then gives the difference of the two starts and of the two
clocks. Several recordings are compared in pairs; weighted least squares over the pairs that match
places them on the time axis of the first.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.errors import UsageError
from rsenf.match.clip_phase import clip_phase
from rsenf.match.matcher import Finding, nothing_to_decide
from rsenf.match.phase import match_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings

Float = NDArray[np.float64]

NAN = math.nan
TWO_CLOCKS = math.sqrt(2.0)
LEAST_OVERLAP = 1e-6  # where no seconds are asked for
CAUTION = 2.0  # factor on stated errors: those of a coded recording are larger
REASONS = {
    "match": "they fit at one offset, and at no other nearly as well",
    "no_match": "they fit at no offset",
    "no_decision": "they fit hardly better than recordings of different times may",
}


@dataclass(frozen=True)
class Against:
    """Result of comparing two recordings."""

    decision: str  # ``match``, ``no_match`` or ``no_decision``: of the same time, on the same grid?
    reason: str
    # start of the first less that of the second, and its standard error; NaN if nothing fits
    offset_s: float = NAN
    offset_std_s: float = NAN
    # likelihood ratio of the same time at this offset against different times
    log10_lr: float = NAN
    log10_lr_other: float = NAN  # likelihood ratio of this offset against any other offset
    # rate of the first clock less that of the second, and its standard error
    clock_ppm: float = NAN
    clock_std_ppm: float = NAN
    verbal: str = ""  # the likelihood ratio in words


def match_against(first: Track, second: Track, settings: MatchSettings) -> Against:
    """Compare two recordings, which may overlap only in part.

    Parameters
    ----------
    first, second : Track
        With phases, or with estimates whose windows don't overlap.
    settings : MatchSettings

    Raises
    ------
    UsageError
        If the windows of one recording's estimates overlap, so that no phase follows from them.
    """
    swap = first.usable > second.usable
    clip, other = (second, first) if swap else (first, second)
    for track in (clip, other):
        if track.usable and clip_phase(track) is None:
            raise UsageError(
                "these estimates carry no phase", "use the ENF method projection for both"
            )
    grid = Grid("the other recording", other.nominal_hz, 0, other.hop_s, other.enf_hz)
    for track in (clip, other):
        reason = nothing_to_decide(track, [replace(grid, nominal_hz=track.nominal_hz)], settings)
        if reason:
            return Against("no_decision", reason)
    if round(clip.nominal_hz) != round(other.nominal_hz):
        return Against("no_match", "one follows a 50 Hz grid, the other a 60 Hz one")
    least = min(1.0, max(settings.min_seconds / (clip.usable * clip.hop_s), LEAST_OVERLAP))
    settings = replace(
        settings,
        min_overlap=least,
        clock_scale_ppm=TWO_CLOCKS * settings.clock_scale_ppm,
        reference_noise_hz=CAUTION * math.sqrt(float(np.nanmean(other.var_hz2))),
    )
    return _result(match_phase(clip, [grid], settings), other, swap)


def _result(found: Finding, other: Track, swap: bool) -> Against:
    # The other's first sample begins half a hop before the centre of its first estimate.
    offset_s = found.lag_s + other.first_s - other.hop_s / 2.0
    sign = -1.0 if swap else 1.0
    return Against(
        decision=found.decision,
        reason=REASONS[found.decision],
        offset_s=sign * offset_s,
        offset_std_s=found.lag_std_s,
        log10_lr=found.log10_lr_absent,
        log10_lr_other=found.log10_lr,
        clock_ppm=sign * found.clock_ppm,
        clock_std_ppm=found.clock_std_ppm,
        verbal=found.verbal,
    )


@dataclass(frozen=True, eq=False)
class Aligned:
    """Recordings on the time axis of the first; NaN where no chain of pairs links one to it."""

    # (recordings,) start of each less the start of the first, and its standard error
    begin_s: Float
    begin_std_s: Float
    # (recordings,) rate of each clock less that of the first, and its standard error
    clock_ppm: Float
    clock_std_ppm: Float
    # root of the reduced chi-square of the pairs about the common alignment; NaN if there are no
    # redundant pairs
    misfit: float
    pairs: dict[tuple[int, int], Against]


def align(tracks: Sequence[Track], settings: MatchSettings) -> Aligned:
    """Place several recordings on the time axis of the first.

    Parameters
    ----------
    tracks : sequence of Track
        Two or more, as for :func:`match_against`.
    settings : MatchSettings
    """
    count = len(tracks)
    pairs = {
        (i, k): match_against(tracks[i], tracks[k], settings)
        for i, k in itertools.combinations(range(count), 2)
    }
    held = {pair: found for pair, found in pairs.items() if found.decision == "match"}
    # A pair's offset and clock are first less second; positions need second less first.
    offsets = {pair: (-a.offset_s, a.offset_std_s) for pair, a in held.items()}
    clocks = {pair: (-a.clock_ppm, a.clock_std_ppm) for pair, a in held.items()}
    begin_s, begin_std_s, misfit = _placed(count, offsets)
    clock_ppm, clock_std_ppm, _ = _placed(count, clocks)
    return Aligned(begin_s, begin_std_s, clock_ppm, clock_std_ppm, misfit, pairs)


def _placed(
    count: int, steps: dict[tuple[int, int], tuple[float, float]]
) -> tuple[Float, Float, float]:
    """Solve for positions from measured differences: positions, standard errors and misfit.

    A recording's own errors enter all its pairs, so no standard error is smaller than that of its
    best pair.
    """
    reached = {0}
    while more := {k for pair in steps if reached & {*pair} for k in pair} - reached:
        reached |= more
    reachable = {pair: step for pair, step in steps.items() if pair[0] in reached}
    place, std = np.full((2, count), NAN)
    place[0] = std[0] = 0.0
    others = sorted(reached - {0})
    if not others:
        return place, std, NAN
    design = np.array([[float(n == k) - float(n == i) for n in others] for i, k in reachable])
    difference, error = (np.array(column) for column in zip(*reachable.values(), strict=True))
    weighted = design / error[:, None]
    covariance = np.linalg.inv(weighted.T @ weighted)
    found = covariance @ weighted.T @ (difference / error)
    freedom = len(reachable) - len(others)
    residual = (design @ found - difference) / error
    misfit = float(np.sqrt(residual @ residual / freedom)) if freedom else NAN
    least = np.array([min(e for pair, (_, e) in reachable.items() if n in pair) for n in others])
    place[others] = found
    std[others] = np.fmax(np.sqrt(np.diag(covariance)), least) * np.fmax(misfit, 1.0)
    return place, std, misfit
