"""Two recordings against each other: were they made at the same time, and how far apart?

The longer one takes the reference's place: its seconds are samples of the grid, as exact as its
estimates are. Nothing else changes; so what is found is the start of one less the start of the
other, and the difference of their two clocks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rsenf.errors import UsageError
from rsenf.match.clip_phase import clip_phase
from rsenf.match.matcher import Finding, nothing_to_decide
from rsenf.match.phase import match_phase
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings

NAN = math.nan
TWO_CLOCKS = math.sqrt(2.0)
CAUTION = 2.0  # of a coded recording's errors over what its estimates claim
REASONS = {
    "match": "they fit at one offset, and at no other nearly as well",
    "no_match": "they fit at no offset",
    "no_decision": "they fit hardly better than recordings of different times may",
}


@dataclass(frozen=True)
class Against:
    """What two recordings say about each other.

    Parameters
    ----------
    decision : {'match', 'no_match', 'no_decision'}
        Whether they were made at the same time, on the same grid.
    reason : str
    offset_s, offset_std_s : float
        Start of the first less the start of the second; NaN when nothing fits.
    log10_lr : float
        For the same time at this offset, against different times.
    log10_lr_other : float
        Against another offset.
    clock_ppm, clock_std_ppm : float
        By how much the first one's clock is faster than the second's.
    verbal : str
    """

    decision: str
    reason: str
    offset_s: float = NAN
    offset_std_s: float = NAN
    log10_lr: float = NAN
    log10_lr_other: float = NAN
    clock_ppm: float = NAN
    clock_std_ppm: float = NAN
    verbal: str = ""


def match_against(first: Track, second: Track, settings: MatchSettings) -> Against:
    """Compare two recordings, of which parts may overlap.

    Parameters
    ----------
    first, second : Track
        With phases, or estimates that don't overlap.
    settings : MatchSettings

    Raises
    ------
    UsageError
        When the estimates of one overlap, so that they have no phase.
    """
    swap = first.usable > second.usable
    clip, other = (second, first) if swap else (first, second)
    for track in (clip, other):
        if track.usable and clip_phase(track) is None:
            raise UsageError(
                "these estimates carry no phase", "use the ENF method projection for both"
            )
    grid = _as_reference(other)
    for track in (clip, other):
        reason = nothing_to_decide(track, [replace(grid, nominal_hz=track.nominal_hz)], settings)
        if reason:
            return Against("no_decision", reason)
    if round(clip.nominal_hz) != round(other.nominal_hz):
        return Against("no_match", "one follows a 50 Hz grid, the other a 60 Hz one")
    least = min(1.0, settings.min_seconds / (clip.usable * clip.hop_s))
    settings = replace(
        settings,
        min_overlap=least,
        clock_scale_ppm=TWO_CLOCKS * settings.clock_scale_ppm,
        reference_noise_hz=CAUTION * math.sqrt(float(np.nanmean(other.var_hz2))),
    )
    return _told(match_phase(clip, [grid], settings), other, swap)


def _as_reference(track: Track) -> Grid:
    """Take a recording's estimates for a grid's samples."""
    return Grid("the other recording", track.nominal_hz, 0, track.hop_s, track.enf_hz)


def _told(found: Finding, other: Track, swap: bool) -> Against:
    # The other's first sample begins half a hop before the middle of its first second.
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
