"""How large an effect is to a model that isn't told of the exposure.

An exposure ``T_e`` leaves ``sinc(f·T_e)`` of what changes at ``f``. A model without one takes what
is left for all there is, and rightly so: its simulation has to show no more. A size found with such
a model is compared with what is shown.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def as_shown(
    name: str, values: dict[str, Any], exposure_s: float, nominal_hz: float
) -> dict[str, Any]:
    """Return an effect's parameters with the size that is left of it.

    Parameters
    ----------
    name : str
        Of the effect.
    values : dict
        Its true parameters.
    exposure_s : float
        That the model isn't told of; 0 where it is told.
    nominal_hz : float
        Of the grid.

    Returns
    -------
    dict
    """
    left = np.sinc(exposure_s * np.array([2.0, 4.0]) * nominal_hz)  # of f_0 and of 2·f_0
    match name:
        case "harmonics":
            return values | {"second_ratio": values["second_ratio"] * abs(left[1] / left[0])}
        case "pwm_tone" | "interharmonic":
            tone_hz = values["tone_hz" if name == "pwm_tone" else "flicker_hz"]
            return values | {
                "depth_ratio": values["depth_ratio"] * abs(np.sinc(tone_hz * exposure_s))
            }
    return values
