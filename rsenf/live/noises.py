"""How far a camera's measured phases may be from the light's, beyond what they claim."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PhaseNoise:
    """One size of the errors of a phase, with its prior weight.

    ``ratio`` times what the estimate claims, and ``floor_rad`` besides. Codecs at low bit rates
    make the phase wander by 0.02 to 0.15 rad, over some seconds.
    """

    weight: float
    ratio: float
    floor_rad: float


# No estimate is taken to be better than the first floor: errors of a tracker hang together from
# second to second, and who believes them to the last digit is sure of what isn't so.
NOISES = (PhaseNoise(0.6, 1.0, 0.03), PhaseNoise(0.3, 2.0, 0.06), PhaseNoise(0.1, 2.0, 0.15))
