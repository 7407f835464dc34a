"""Mains light, or something else that repeats? One decision for all that follows flicker.

What repeats near a grid's alias need not be mains light: stripes that move, text that scrolls, a
shaken texture, key frames, a dimmer's pulses. Mains light multiplies all of a row alike, however
bright or dark what it falls on is; its phase runs down the rows in a frame's time at most; and its
frequency is near a grid's, and never rests. A moving pattern is added to the picture or hides it,
and its phase depends on the place.

So the picture is cut into cells, some bands of rows in each strip, and it is asked how much of what
turns with the phase that is followed is *one light with smooth shares in the picture*
(:func:`light_of`); and how the phase moves is measured in the directions in which a grid's does
(:mod:`rsenf.flicker.wander`). :func:`why_not` decides. No limit is on strength: a weak light
passes, and a strong pattern doesn't.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import alias_hz
from rsenf.flicker.wander import STEADY, Wander

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

BANDS = 24
ORDER = 2  # of the polynomials, in place, by which a light's share varies over the picture
# Turns beside the phase, over the window, at which the noise is looked up.
BESIDE = np.array([m for m in range(-8, 9) if abs(m) >= 3])
TURNS_STEP = 0.05
GROUP, LINES = 4, 3  # bands that share a phase; and how many phases, and rounds, make a line
# Farther than this from 0 Hz, and from half the frame rate, a tone is told from its mirror image.
APART_HZ = 0.5

# Share of a true light that smooth shares explain: 0.87 to 1 in 60 films of two lamps, daylight
# from one side and sharp shadows; 0 to 0.6 in stripes, shakes and fans but for upright ones, and
# 0.74 in a film of dashes on a road.
LEAST_EXPLAINED, USUALLY_EXPLAINED = 0.8, 0.93
LEAST_SNR, MOST_STD = 10.0, 0.15
# Shorter windows seldom tell whether it wanders, and patterns last through them: light has to be
# clear there.
BRIEF_S, CLEARLY_EXPLAINED, CLEAR_STD = 8.0, 0.87, 0.03
# A pattern that is added leaves so much less unexplained without the texture, and no light does;
# light that shows on bright and dark leaves so much less with it. Below a share neither counts.
ADDED, MULTIPLIED = 1.5, 2.0
LEAST_ADDED, LEAST_MULTIPLIED = 0.04, 0.02
BEYOND_FRAME, TURNS_STD = 1.02, 0.1  # read-out over a frame's time; of turns
# Alias of a nominal, about which all that moves slowly is; and near half the frame rate all that
# alternates from frame to frame, such as what an encoder does.
CREEPS_HZ = 1.0
AT_ONCE = 0.15  # turns, below which rows may all show the same
# Illumination frequencies off the nominal: more than a large grid's, even with a frame rate that is
# taken for its neighbour, a thousandth off; and such as a second harmonic's mirror image explains.
FARTHEST_HZ, UNUSUAL_HZ = 0.3, 0.15
# What quartz makes: monitors, dimmers. Hz, and their tolerance.
QUARTZ_HZ = (60 / 1.001, 60.0, 72.0, 75.0, 120 / 1.001, 120.0, 144.0, 200.0, 240.0, 250.0, 300.0,
             400.0, 480.0, 500.0, 1000.0)  # fmt: skip
QUARTZ_RATIO, QUARTZ_OFF_HZ = 1e-4, 0.02
KEY_FRAMES = (8, 10, 12, 15, 16, 20, 24, 25, 30, 48, 50, 60)  # usual numbers from one to the next
KEY_FRAMES_HZ = (0.05, 0.01)  # where all rows show the same, and where some may be apart
# Weaker flicker is nobody's: rounding, and what an exposure of a whole number of periods leaves.
MIN_FLICKER_RATIO = 1e-4
# Of a lamp that flickers by so much an exposure of a whole number of periods leaves a share that
# goes as the grid's deviation, |f_0 − N/T_e|·T_e/N, and changes sign with it: where the grid passes
# its nominal the phase jumps by half a turn. Nobody should rest a claim on it.
STRONG_RATIO = 0.4

PATTERN = "a pattern that moves, not light: it doesn't brighten all of a row alike, bright and dark"
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
KEYED = "all rows brighten at once, every so many frames: key frames, or a global shutter"


@dataclass(frozen=True, kw_only=True)
class Light:
    """What cells show that turns with a phase.

    Attributes
    ----------
    turns : float
        Down the rows of a frame.
    explained, explained_std : float
        Share of it that one light explains: the texture times a ramp times smooth complex shares.
    added : float
        The same of a pattern that is added to the picture: without the texture.
    snr : float
        Power of that light over what noise has of it.
    hz_std : float
        How well its frequency is known, by that and the time (Cramér–Rao).
    apart_turns : float
        By how much its phase strays from one ramp that all strips share, rms: where the light of
        several lamps in several phases mixes differently.
    is_brief : bool
        Whether hardly any time was looked at.
    """

    turns: float
    explained: float
    explained_std: float
    added: float
    snr: float
    hz_std: float
    apart_turns: float
    is_brief: bool

    @property
    def is_added(self) -> bool:
        """Whether it is likelier added to the picture than its light."""
        left = 1.0 - self.explained
        least = max(LEAST_ADDED, 3.0 * self.explained_std)
        return left > max(ADDED * (1.0 - self.added), least)

    @property
    def is_multiplied(self) -> bool:
        """Whether it is shown to multiply bright and dark, not only let pass."""
        least = max(LEAST_MULTIPLIED, 3.0 * self.explained_std)
        return 1.0 - self.added > max(MULTIPLIED * (1.0 - self.explained), least)

    def why_not(self, most_turns: float, wander: Wander) -> str:
        """Say why it can't be mains light; '' where it can.

        Parameters
        ----------
        most_turns : float
            Of a read-out that takes all of a frame.
        wander : Wander
            How its phase strays: what moves less than most grids do has to be clearer light.
        """
        if self.snr < LEAST_SNR or self.explained_std > (CLEAR_STD if self.is_brief else MOST_STD):
            return NOT_ONE
        is_calm = 0.0 < wander.squares < wander.known
        least = CLEARLY_EXPLAINED if self.is_brief or is_calm else LEAST_EXPLAINED
        least = USUALLY_EXPLAINED if wander.is_steady else least
        if self.explained + self.explained_std < least or self.is_added:
            return PATTERN
        if abs(self.turns) > BEYOND_FRAME * most_turns + TURNS_STD:
            return TOO_LONG
        return ""


def why_not(
    f0_hz: float, nominal_hz: float, frame_rate_hz: float, wander: Wander, light: Light | None
) -> str:
    """Say why what was followed isn't a grid's light; '' where it may be.

    Parameters
    ----------
    f0_hz : float
        Mean frequency of the light's first harmonic.
    nominal_hz, frame_rate_hz : float
        Of the grid that it is taken for, and of the frames.
    wander : Wander
    light : Light, optional
        What the cells show; none where they can't be told apart.
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
    if light.is_brief and not wander.is_seen and _is_quartz(f0_hz, frame_rate_hz):
        return TOO_BRIEF
    if is_unusual and not light.is_multiplied:
        return NO_GRID
    seen_hz = abs(alias_hz(2.0 * nominal_hz, frame_rate_hz))
    creeps = min(seen_hz, frame_rate_hz / 2.0 - seen_hz) < CREEPS_HZ
    if creeps and not (light.is_multiplied or wander.is_seen):
        return CREEPS
    if _is_keyed(f0_hz, light, frame_rate_hz, wander):
        return KEYED
    return light.why_not(f0_hz / frame_rate_hz, wander)


def is_faint(flicker_ratio: float, f0_hz: float, nominal_hz: float) -> bool:
    """Whether flicker may be what an exposure of a whole number of periods leaves of a strong one.

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


def is_second_harmonic(f0_hz: float, nominal_hz: float, frame_rate_hz: float, turns: float) -> bool:
    """Whether the tone that was followed is likelier the second harmonic of usual light.

    Where ``2·f_0`` shows at, or mirrored to, where ``f_0`` of another deviation would, a lamp whose
    second harmonic survives a codec better than its first looks like light at that deviation. A
    mirror image runs up the rows: ``turns`` of the phase down them are negative.
    """
    carrier_hz = 2.0 * nominal_hz
    off_hz = abs(f0_hz - carrier_hz)
    for sign in (1.0, -1.0) if turns < 0.0 else (1.0,):
        times = round((2.0 * carrier_hz - sign * f0_hz) / frame_rate_hz)
        first_hz = (times * frame_rate_hz + sign * f0_hz) / 2.0
        # A second harmonic is off by twice as much as the first, where that is it.
        if off_hz > UNUSUAL_HZ and abs(first_hz - carrier_hz) < 0.6 * off_hz:
            return True
    return False


def _is_quartz(f0_hz: float, frame_rate_hz: float) -> bool:
    """Whether something that a quartz drives shows where this frequency does."""
    seen_hz = abs(alias_hz(f0_hz, frame_rate_hz))
    return any(
        abs(abs(alias_hz(hz, frame_rate_hz)) - seen_hz) < min(QUARTZ_RATIO * hz, QUARTZ_OFF_HZ)
        for hz in QUARTZ_HZ
    )


def _is_keyed(f0_hz: float, light: Light, frame_rate_hz: float, wander: Wander) -> bool:
    """Whether all rows brighten at once, with a usual number of frames between.

    And it isn't seen to wander as a grid does.
    """
    if abs(light.turns) > AT_ONCE:
        return False
    if wander.known >= min(STEADY) and wander.squares > 1.0 and not wander.is_restless:
        return False
    seen = abs(alias_hz(f0_hz, frame_rate_hz)) / frame_rate_hz
    # A train of pulses has lines beside each other, which bend a path that is no grid's.
    most_hz = KEY_FRAMES_HZ[0 if abs(light.turns) < TURNS_STEP else 1] + 2.0 * light.hz_std
    return any(abs(seen - round(seen * n) / n) * frame_rate_hz < most_hz for n in KEY_FRAMES)


def tells_cells(f0_hz: float, frame_rate_hz: float) -> bool:
    """Whether a tone is far enough from its mirror image for cells to tell what it is."""
    seen_hz = abs(alias_hz(f0_hz, frame_rate_hz))
    return APART_HZ <= seen_hz <= frame_rate_hz / 2.0 - APART_HZ


def bands_of(rows: int) -> int:
    """How many bands there are of so many rows."""
    return min(rows, BANDS)


@functools.lru_cache(maxsize=8)
def _bands(rows: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """First row of each band, and one over how many it has."""
    edges = np.linspace(0, rows, bands_of(rows) + 1).astype(np.intp)
    return edges[:-1], (1.0 / np.diff(edges)[:, None]).astype(np.float32)


def cell_means(level: NDArray[Any]) -> NDArray[Any]:
    """Mean level of each cell, (frames, bands, strips), of rows, (frames, rows, strips)."""
    starts, share = _bands(level.shape[1])
    means = np.add.reduceat(level, starts, axis=1)
    means *= share
    return means


def look_at(
    seen: NDArray[np.floating],
    t_s: Float,
    phase_rad: Float,
    bands: int,
    f0_hz: float,
    frame_rate_hz: float,
) -> Light:
    """Look at what turns with a phase, beside the texture where it hardly turns.

    Parameters
    ----------
    seen, t_s, phase_rad, bands
        As :func:`light_of` takes them.
    f0_hz, frame_rate_hz : float
        Of the harmonic that is followed, and of the frames.
    """
    look = light_of if tells_cells(f0_hz, frame_rate_hz) else still_light_of
    return look(seen, t_s, phase_rad, bands, f0_hz / frame_rate_hz)


def light_of(
    seen: NDArray[np.floating], t_s: Float, phase_rad: Float, bands: int, most_turns: float
) -> Light:
    """Look at what turns with a phase.

    Parameters
    ----------
    seen : ndarray, shape (frames, bands · strips)
        Cells, as :func:`cell_means` has them.
    t_s, phase_rad : ndarray, shape (frames,)
        Times, and the phase of the harmonic that is followed.
    bands : int
    most_turns : float
        Of that harmonic, for a read-out that takes all of a frame.
    """
    level, tone, beside = _tones(seen.astype(np.float64), t_s, phase_rad)
    return _light(level, tone, beside, bands, most_turns, t_s)


def still_light_of(
    seen: NDArray[np.floating], t_s: Float, phase_rad: Float, bands: int, most_turns: float
) -> Light:
    """Look at what turns with a phase that hardly turns: with the texture, and not beside it.

    Parameters
    ----------
    seen : ndarray, shape (bins, bands · strips)
        Means of cells over bins of time.
    t_s, phase_rad : ndarray, shape (bins,)
    bands : int
    most_turns : float
    """
    waves = np.column_stack([np.ones_like(t_s), np.cos(phase_rad), np.sin(phase_rad)])
    (level, cosine, sine), *_ = np.linalg.lstsq(waves, seen, rcond=None)
    left = seen - waves @ np.array([level, cosine, sine])
    beside = _tones(left, t_s, phase_rad)[2]
    return _light(level, cosine - 1j * sine, beside, bands, most_turns, t_s)


def _light(
    level: Float, tone: Complex, beside: Complex, bands: int, most_turns: float, t_s: Float
) -> Light:
    """Judge the tones of cells: (cells,), (cells,), (beside, cells).

    Each cell counts by how little noise it has, up to what is usual.
    """
    place, shape = (np.arange(bands) + 0.5) / bands, (bands, level.size // bands)
    var = np.mean(np.abs(beside) ** 2, axis=0)
    trust = 1.0 / np.sqrt(var + np.median(var) + 1e-12)
    tone, beside, level = tone * trust, beside * trust, (level * trust).reshape(shape)
    most = min(1.5 * most_turns + 1.0, (bands - 1) / 2.0)
    turns = _turns(tone.reshape(shape) * level, place, most)
    ramp = np.exp(2j * np.pi * turns * place)[:, None]
    shares = _shares(place, shape[1])
    evenly = ramp * trust.reshape(shape)
    own = max(float(_power(tone) - _power(beside).mean()), 1e-9)

    def explained(basis: Complex) -> tuple[float, float]:
        """Share of what turns that a basis explains, and its power over the noise's."""
        axes, _ = np.linalg.qr(basis.reshape(len(basis), -1).T)
        power, noises = (_power(of @ axes.conj()) for of in (tone, beside))
        return float(power - noises.mean()) / own, float(power / max(noises.mean(), 1e-9))

    straight = level * ramp.conj()
    by_light, snr = explained(shares * (ramp * level))
    # One strip's texture may be anybody's: it doesn't say what is added.
    return Light(
        turns=turns,
        explained=by_light,
        explained_std=float(_power(beside).std()) / own,
        added=explained(shares * evenly)[0] if shape[1] > 1 else by_light,
        snr=snr,
        hz_std=float(np.sqrt(6.0 / max(snr, 1e-9)) / (2.0 * np.pi * (t_s[-1] - t_s[0]))),
        apart_turns=_apart_turns(
            tone.reshape(shape) * straight, beside.reshape(-1, *shape) * straight, place
        ),
        is_brief=bool(np.rint(t_s[-1] - t_s[0]) < BRIEF_S),
    )


def _apart_turns(light: Complex, noise: Complex, place: Float) -> float:
    """Stray of a light's phase, (bands, strips), from a line down the rows, rms, without noise's.

    Noise has the shape (beside, bands, strips).
    """
    starts = np.arange(0, place.size, GROUP)
    light, noise = (np.add.reduceat(x, starts, axis=-2) for x in (light, noise))
    weight = np.abs(light) ** 2
    if len(starts) < LINES or not np.abs(light.sum()) > 0.0:
        return 0.0
    middle = np.add.reduceat(place, starts) / np.diff(np.append(starts, place.size))
    down = np.broadcast_to((middle - middle.mean())[:, None], light.shape)
    for _ in range(LINES):
        light = light / np.exp(1j * np.angle(light.sum()))
        slope = np.sum(weight * down * np.angle(light)) / np.sum(weight * down**2)
        light = light * np.exp(-1j * slope * down)
    var_rad2 = np.sum(weight * np.angle(light) ** 2) - np.sum(np.abs(noise) ** 2) / len(noise) / 2.0
    return float(np.sqrt(max(var_rad2 / np.sum(weight), 0.0))) / (2.0 * np.pi)


def _tones(seen: Float, t_s: Float, phase_rad: Float) -> tuple[Float, Complex, Complex]:
    """Mean levels, tones at the phase, and tones beside it: (cells,), (cells,), (beside, cells).

    Under a Hann window, drifts taken off.
    """
    x = (t_s - t_s[0]) / (t_s[-1] - t_s[0]) - 0.5
    weight = np.cos(np.pi * x) ** 2
    weight /= weight.sum()
    line = x - weight @ x
    level = weight @ seen
    left = seen - level - np.outer(line, (weight * line) @ seen / ((weight * line) @ line))
    angle = phase_rad[:, None] + 2.0 * np.pi * np.append(0, BESIDE) * x[:, None]
    cosine, sine = (weight[:, None] * wave for wave in (np.cos(angle), np.sin(angle)))
    tones = 2.0 * (cosine.T @ left - 1j * (sine.T @ left))
    return level, tones[0], tones[1:]


def _turns(tone: Complex, place: Float, most: float) -> float:
    """Turns down the rows, whatever the phase of each strip is."""
    half = np.ceil(most / TURNS_STEP)
    turns = np.arange(-half, half + 1) * TURNS_STEP
    return float(turns[np.argmax(_power(np.exp(-2j * np.pi * np.outer(turns, place)) @ tone))])


def _shares(place: Float, strips: int) -> Float:
    """Smooth shares over the picture, shape (shares, bands, strips)."""
    down = (2.0 * place - 1.0)[:, None]
    across = np.linspace(-1.0, 1.0, strips)[None, :] if strips > 1 else np.zeros((1, 1))
    orders = [(i, j) for i in range(ORDER + 1) for j in range(min(ORDER - i, strips - 1) + 1)]
    return np.array([down**i * across**j for i, j in orders])


def _power(tone: Complex) -> Float:
    return np.asarray(np.sum(np.abs(tone) ** 2, axis=-1))
