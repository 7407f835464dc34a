"""The small rest that real cameras have and nobody names."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .courses import unit, wander
from .in_level import FULL
from .light import Array
from .plan import Moment, Plan

PART = 1e-4


def leave_rest(plan: Plan, strength: float, rng: np.random.Generator) -> None:
    """Add three nameless parts of `strength` times 1e-4 each.

    A smooth pattern over rows that changes slowly and the light's own slow wander, both relative
    and rms; and a bend of the response by that share of full scale.
    """
    size = PART * strength
    pattern = unit(gaussian_filter1d(rng.standard_normal(plan.rows), plan.rows / 15))
    of_pattern, of_light = (size * wander(rng, plan.start_s) for _ in range(2))

    def varied(moment: Moment, level: Array) -> Array:
        share = of_pattern[moment.frame][:, None] * pattern + of_light[moment.frame][:, None]
        return np.asarray(level * (1 + share[:, :, None]))

    plan.on_level.append(varied)
    waves, angle = rng.uniform(0.8, 2.0), rng.uniform(0, 2 * np.pi)

    def bent(level: Array) -> Array:
        return np.asarray(level + size * FULL * np.sin(2 * np.pi * waves * level / FULL + angle))

    plan.curves.append(bent)
