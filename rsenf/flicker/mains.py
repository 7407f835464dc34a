"""Decides whether a periodic signal is mains light; one decision for all that track flicker.

What repeats near a grid's alias need not be mains light: stripes that move, text that scrolls, a
shaken texture, key frames, a dimmer's pulses.

Model: mains light multiplies all of a row alike, bright or dark; its phase runs down the rows
within a frame period; its frequency is near a grid's, and never constant. A moving pattern is added
to the picture or hides it, and its phase depends on the place.

Statistic: those of picture cells (:mod:`rsenf.flicker.cell_light`) and of the phase's wander in the
principal directions of a grid's (:mod:`rsenf.flicker.grid_prior`). :func:`why_not` decides.

Approximate: no threshold is on strength, so that a weak light passes, and a strong pattern doesn't;
a pattern that wanders as a grid does, and multiplies, is taken for light.

References
----------
- Garg, R., Varna, A. L., Hajj-Ahmad, A. and Wu, M. (2013), "Seeing" ENF: power-signature-based
  timestamp for digital multimedia via optical sensing and signal processing, IEEE Trans.
  Information Forensics and Security 8, 1417.
"""

from __future__ import annotations

from rsenf.flicker.cell_light import TURNS_STEP, CellLight
from rsenf.flicker.grid_prior import STEADY, Wander
from rsenf.flicker.lines import alias_hz

# Least share that one light explains; the second without wander. True light: 0.87 to 1 in 60 films
# of two lamps, daylight from one side and sharp shadows. Stripes, shakes and fans: 0 to 0.6 except
# for upright ones, and 0.74 in a film of dashes on a road.
LEAST_EXPLAINED, USUALLY_EXPLAINED = 0.8, 0.93
LEAST_SNR, MOST_STD = 10.0, 0.15
# In windows too short to show wander, light must be clear: patterns may last that long.
CLEARLY_EXPLAINED, CLEAR_STD = 0.87, 0.03
# A codec suppresses the flicker of some blocks, but hardly changes its phase: 0.86 to 0.98 of the
# signal in films at 50 to 150 kb/s. So does a pattern that moves down, but it never wanders. Patchy
# light behind a codec explains 0.26 or more and has an SNR of 2300 at most; pictures of monitors
# explain 0.02 to 0.2, or have far more.
LEAST_IN_PHASE, LEAST_PATCHY, MOST_PATCHY_SNR = 0.8, 0.2, 1e4
# Least share in phase with one ramp: 0.95 to 1 in raw films of 20 kinds of light, 0.77 behind the
# strongest codecs; 0.3 in stripes that looked multiplied.
ONE_RAMP = 0.5
# Share of a tone with an equal image: 0.01 to 0.24 of light that turns, 0.76 of a codec's product.
MOST_IMAGE = 0.5
BEYOND_FRAME, TURNS_STD = 1.02, 0.1  # largest read-out over the frame period; tolerance in turns
# An alias nearer to 0 Hz is also that of slow motion; nearer to half the frame rate, of all that
# alternates from frame to frame, such as an encoder's effects.
CREEPS_HZ = 1.0
AT_ONCE = 0.25  # turns, below which all rows may be in phase
# Deviations of the illumination frequency: larger than a large grid's, even if the frame rate is
# mistaken for its neighbour 0.1 % off; one that a second harmonic's mirror image may explain; and
# one that the continental grid exceeds in an eighth of the time.
FARTHEST_HZ, UNUSUAL_HZ, SELDOM_HZ = 0.3, 0.15, 0.06
# Frequencies driven by quartz (monitors, dimmers), Hz, and their tolerance.
QUARTZ_HZ = (60 / 1.001, 60.0, 72.0, 75.0, 120 / 1.001, 120.0, 144.0, 200.0, 240.0, 250.0, 300.0,
             400.0, 480.0, 500.0, 1000.0)  # fmt: skip
QUARTZ_RATIO, QUARTZ_OFF_HZ = 1e-4, 0.02
KEY_FRAMES = (8, 10, 12, 15, 16, 20, 24, 25, 30, 48, 50, 60)  # usual intervals in frames
KEY_FRAMES_HZ = (0.05, 0.01)  # tolerance if all rows are in phase, and if some may differ
# Weaker flicker isn't used: rounding, and what an exposure of a whole number of periods leaves.
MIN_FLICKER_RATIO = 1e-4
# Strong flicker of a lamp. An exposure of N whole periods leaves |f_0 − N/T_e|·T_e/N of it, in
# proportion to the grid's deviation, and with its sign: the phase jumps by half a turn where the
# grid crosses its nominal frequency, so that nothing can be concluded from it.
STRONG_RATIO = 0.4

PATTERN = "a pattern that moves, not light: it doesn't brighten all of a row alike, bright and dark"
PATCHY = (
    "it shows in some places and not in others, as light does behind a strong codec and patterns "
    "do, and hasn't been seen to move as a grid does"
)
NOT_ONE = "what repeats doesn't stand out from what varies in single parts of the picture"
TOO_LONG = "by the rows' phases a frame would take longer to read than it lasts: other light"
NO_GRID = (
    "what turns moves as no grid's phase does: another light, another speed, or wrong frame times?"
)
SECOND = "what was followed is likelier the second harmonic of the light than the first"
TOO_STEADY = "its frequency never moves, as a grid's does: a pattern, a monitor, or a dimmed lamp"
TOO_BRIEF = "too short to tell whether a grid drives it or a quartz: a monitor, or a dimmed lamp"
CREEPS = "it hardly moves from frame to frame, and nothing shows that it is light: a slow pattern?"
FAINT = (
    "hardly any flicker: an exposure of a whole number of its periods (anti-flicker), or a nearly "
    "steady light"
)
UNFILTERED = "decoded without the loop filter, what repeats may be the codec's: decode it in full"
PRODUCT = "light that stands still, times the pattern of an encoder's frame types"
KEYED = "all rows brighten at once, every so many frames: key frames, or a global shutter"


def why_not(
    f0_hz: float,
    nominal_hz: float,
    frame_rate_hz: float,
    wander: Wander,
    light: CellLight | None,
    *,
    unfiltered: bool,
    has_moved: bool = False,
) -> str:
    """Return why a tracked signal isn't a grid's light; '' if it may be.

    Parameters
    ----------
    f0_hz : float
        Mean frequency of the signal, taken for the light's first harmonic.
    nominal_hz, frame_rate_hz : float
        Nominal frequency of the assumed grid; frame rate.
    wander : Wander
    light : CellLight, optional
        Statistics of the cells; None where cells can't be distinguished.
    unfiltered : bool
        Whether any of the rows were decoded without the codec's loop filter. Then light that stands
        still in the picture is multiplied by the pattern of frame types.
    has_moved : bool, optional
        Whether earlier windows showed the wander of a grid.
    """
    if light and is_second_harmonic(f0_hz, nominal_hz, frame_rate_hz, light.turns):
        return SECOND
    if abs(f0_hz - 2.0 * nominal_hz) > FARTHEST_HZ or wander.is_restless:
        return NO_GRID
    is_unusual = abs(f0_hz - 2.0 * nominal_hz) > UNUSUAL_HZ
    if wander.is_steady and (is_unusual or _is_quartz(f0_hz, frame_rate_hz)):
        return TOO_STEADY
    if light is None:
        return ""
    # A grid is seldom that far off, and must then be seen to wander where it can be.
    is_seldom = wander.known > 0 and abs(f0_hz - 2.0 * nominal_hz) > SELDOM_HZ
    must_wander = light.is_brief or is_seldom
    if must_wander and not wander.is_seen and _is_quartz(f0_hz, frame_rate_hz):
        return TOO_BRIEF
    if is_unusual and not light.is_multiplied:
        return NO_GRID
    seen_hz = abs(alias_hz(2.0 * nominal_hz, frame_rate_hz))
    creeps = min(seen_hz, frame_rate_hz / 2.0 - seen_hz) < CREEPS_HZ
    if creeps and not (light.is_multiplied or wander.is_seen):
        return CREEPS
    if _is_keyed(f0_hz, light, frame_rate_hz, wander):
        return KEYED
    why = why_not_light(light, f0_hz / frame_rate_hz, wander, has_moved=has_moved)
    is_clear = wander.is_seen or has_moved or light.explained >= USUALLY_EXPLAINED
    return UNFILTERED if unfiltered and not (why or is_clear) else why


def why_not_light(
    light: CellLight, most_turns: float, wander: Wander, *, has_moved: bool = False
) -> str:
    """Return why the cells' signal can't be mains light; '' if it can.

    Parameters
    ----------
    light : CellLight
    most_turns : float
        Turns for a read-out over the whole frame period.
    wander : Wander
        Of the signal's phase: one that moves less than most grids' requires clearer light.
    has_moved : bool, optional
        Whether earlier windows showed the wander of a grid.
    """
    if light.snr < LEAST_SNR or light.explained_std > (CLEAR_STD if light.is_brief else MOST_STD):
        return NOT_ONE
    is_calm = 0.0 < wander.squares < wander.known
    least = CLEARLY_EXPLAINED if light.is_brief or is_calm else LEAST_EXPLAINED
    least = USUALLY_EXPLAINED if wander.is_steady else least
    is_patchy = light.explained + light.explained_std < least
    is_coded = light.in_phase > LEAST_IN_PHASE and light.snr < MOST_PATCHY_SNR
    is_coded = is_coded and light.explained > LEAST_PATCHY
    if light.is_added or (is_patchy and not is_coded) or light.in_phase < ONE_RAMP:
        return PATTERN
    if light.image > MOST_IMAGE:
        return PRODUCT
    if abs(light.turns) > BEYOND_FRAME * most_turns + TURNS_STD:
        return TOO_LONG
    moves = wander.is_grids or (has_moved and not wander.is_steady)
    return PATCHY if is_patchy and not moves else ""


def is_faint(flicker_ratio: float, f0_hz: float, nominal_hz: float) -> bool:
    """Whether flicker may be what an exposure of a whole number of periods leaves of a strong one.

    Parameters
    ----------
    flicker_ratio : float
        Amplitude of the first harmonic over the mean light.
    f0_hz : float
        Its frequency.
    nominal_hz : float
        Nominal grid frequency.

    Examples
    --------
    >>> is_faint(2e-4, 100.1, 50.0), is_faint(2e-3, 100.1, 50.0)
    (True, False)
    """
    residual_ratio = STRONG_RATIO * abs(f0_hz / (2.0 * nominal_hz) - 1.0)
    return flicker_ratio < max(MIN_FLICKER_RATIO, residual_ratio)


def is_second_harmonic(f0_hz: float, nominal_hz: float, frame_rate_hz: float, turns: float) -> bool:
    """Whether the tracked tone is more likely the second harmonic of ordinary light.

    If ``2·f_0``, or its mirror image, has the alias of ``f_0`` at another deviation, a lamp whose
    second harmonic survives a codec better than its first looks like light at that deviation. A
    mirror image runs up the rows: ``turns``, of the phase down the rows, is negative.

    Parameters
    ----------
    f0_hz, nominal_hz, frame_rate_hz : float
    turns : float
    """
    carrier_hz = 2.0 * nominal_hz
    off_hz = abs(f0_hz - carrier_hz)
    for sign in (1.0, -1.0) if turns < 0.0 else (1.0,):
        times = round((2.0 * carrier_hz - sign * f0_hz) / frame_rate_hz)
        first_hz = (times * frame_rate_hz + sign * f0_hz) / 2.0
        # A true second harmonic deviates by twice as much as the first.
        if off_hz > UNUSUAL_HZ and abs(first_hz - carrier_hz) < 0.6 * off_hz:
            return True
    return False


def _is_quartz(f0_hz: float, frame_rate_hz: float) -> bool:
    """Whether something driven by a quartz has the same alias as this frequency."""
    seen_hz = abs(alias_hz(f0_hz, frame_rate_hz))
    return any(
        abs(abs(alias_hz(hz, frame_rate_hz)) - seen_hz) < min(QUARTZ_RATIO * hz, QUARTZ_OFF_HZ)
        for hz in QUARTZ_HZ
    )


def _is_keyed(f0_hz: float, light: CellLight, frame_rate_hz: float, wander: Wander) -> bool:
    """Whether all rows brighten at once, at a usual key-frame interval.

    And the phase isn't seen to wander as a grid's does.
    """
    if abs(light.turns) > AT_ONCE:
        return False
    if wander.known >= min(STEADY) and wander.squares > 1.0 and not wander.is_restless:
        return False
    seen = abs(alias_hz(f0_hz, frame_rate_hz)) / frame_rate_hz
    # Neighbouring lines of a pulse train bend the path, which isn't a grid's wander.
    most_hz = KEY_FRAMES_HZ[0 if abs(light.turns) < TURNS_STEP else 1] + 2.0 * light.hz_std
    return any(abs(seen - round(seen * n) / n) * frame_rate_hz < most_hz for n in KEY_FRAMES)
