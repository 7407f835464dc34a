"""Prior for errors of measured phases beyond their standard errors."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PhaseNoise:
    """One noise model, with its prior weight: ``ratio`` times the standard error, plus a floor.

    Codecs at low bit rates make the phase wander by 0.02 to 0.15 rad over some seconds.
    """

    weight: float
    ratio: float
    floor_rad: float


# No estimate counts as better than the first floor: a tracker's errors are correlated from second
# to second, and taking them as independent makes the test overconfident.
NOISES = (PhaseNoise(0.6, 1.0, 0.03), PhaseNoise(0.3, 2.0, 0.06), PhaseNoise(0.1, 2.0, 0.15))
