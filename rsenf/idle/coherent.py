"""The coherent estimator: maximum likelihood over all frames, rows and harmonics."""

from __future__ import annotations

from rsenf.idle.limits import MIN_COHERENCE, NO_RAMP, STILL, WEAK, hardly_turned, is_weak
from rsenf.idle.ramp import Profile, find_ramp
from rsenf.idle.row_tones import coherence, row_tones
from rsenf.idle.seen import Finding, Seen
from rsenf.idle.spread import bend_var, freedom, jackknife_var
from rsenf.idle.still import still

BEYOND = 1.05  # of the steepest ramp that a frame has room for: its peak may lie a little outside


def conclude(seen: Seen) -> Finding:
    """Conclude from the most likely ramp down the rows."""
    if seen.stands_still:
        return still(seen)
    if hardly_turned(seen):
        return STILL
    ramp = find_ramp(seen.moments, BEYOND * seen.most_turns)
    if is_weak(seen, ramp.flicker_ratio):
        return WEAK
    tone, level = row_tones(seen.moments)
    if coherence(tone, level, ramp.turns) < MIN_COHERENCE:
        return NO_RAMP
    profile = Profile(seen.moments, seen.moments.harmonics(), ramp.brightness)
    variance = max(
        jackknife_var(profile, ramp.turns), bend_var(profile, ramp.turns), ramp.bound_var
    )
    return Finding.of_turns(ramp.turns, variance, seen.f0_hz, freedom(ramp.brightness.size))
