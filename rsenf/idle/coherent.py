"""The coherent estimator: maximum likelihood over all frames, rows and harmonics."""

from __future__ import annotations

from rsenf.idle.limits import MIN_FLICKER_RATIO, STILL, WEAK, too_still
from rsenf.idle.moments import HARMONICS
from rsenf.idle.ramp import Profile, find_ramp
from rsenf.idle.seen import Finding, Seen
from rsenf.idle.spread import jackknife_var

BEYOND = 1.05  # of the steepest ramp that a frame has room for: its peak may lie a little outside


def coherent(seen: Seen) -> Finding:
    """Conclude from the most likely ramp down the rows."""
    if too_still(seen):
        return STILL
    ramp = find_ramp(seen.moments, BEYOND * seen.most_turns)
    if ramp.flicker_ratio < MIN_FLICKER_RATIO:
        return WEAK
    profile = Profile(seen.moments, HARMONICS, ramp.brightness)
    variance = max(jackknife_var(profile, ramp.turns), ramp.bound_var)
    return Finding.of_turns(ramp.turns, variance)
