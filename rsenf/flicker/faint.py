"""Flicker too faint to be that of a lamp."""

# Weaker flicker is nobody's: rounding, and what an exposure of a whole number of periods leaves.
MIN_FLICKER_RATIO = 1e-4
# Of a lamp that flickers by so much an exposure of a whole number of periods leaves a share that
# goes as the grid's deviation, |f_0 − N/T_e|·T_e/N, and changes sign with it: where the grid passes
# its nominal the phase jumps by half a turn. Nobody should rest a claim on it.
STRONG_RATIO = 0.4
FAINT = (
    "hardly any flicker: an exposure of a whole number of its periods (anti-flicker), or a nearly "
    "steady light"
)


def is_faint(flicker_ratio: float, f0_hz: float, nominal_hz: float) -> bool:
    """Whether flicker may be what such an exposure leaves of a strong lamp's.

    Parameters
    ----------
    flicker_ratio : float
        Amplitude of the first harmonic over the mean light.
    f0_hz : float
        Its frequency.
    nominal_hz : float
        Of the grid.
    """
    left_ratio = STRONG_RATIO * abs(f0_hz / (2.0 * nominal_hz) - 1.0)
    return flicker_ratio < max(MIN_FLICKER_RATIO, left_ratio)
