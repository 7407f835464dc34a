"""Detects clips that were converted to another frame rate, by their light, and undoes it.

Model: a converter shows, at each of its own times, the newest frame that the camera had taken by
then: of ``F`` frames/s shown at a rate ``R``, picture ``m`` is number ``⌊m·F/R + a⌋``. Its time
stamp is late by up to a frame period of the camera, with a regular beat, so that light which is one
tone by the frames' own times is several by the stamps. Blending neighbours has a similar effect.

Statistic: the power of the pictures' change that light explains at the times of each usual camera
rate, against that by the stamps as they are: a likelihood ratio with unknown noise variance. Waves
below 1 Hz are fitted with both, since motion makes them; not with blending, that explains all.

Approximate: only usual camera rates are tried, and the noise is taken as white.

References
----------
- Kay, S. M. (1998), Fundamentals of Statistical Signal Processing, vol. II: Detection Theory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATES_HZ = (24e3 / 1001, 24.0, 25.0, 30e3 / 1001, 30.0, 48.0, 50.0, 60e3 / 1001, 60.0)
SAME_RATE_RATIO = 3e-3  # rates that differ by less drift apart too slowly for a window
PARTS = 4  # principal components of the pictures' change in which light is sought
OFFSETS_HZ = 0.4  # half-width of the search around the nominal illumination frequency
PLACES, FINE = 16, 33  # beat phases tried, and around the best
OFF_RATIO = (0.0, -3e-4, 3e-4)  # deviations of cameras from their nominal rate
OFF_STD_RATIO = 5e-5  # standard error of a deviating rate
PADDED = 4  # zero padding of a spectrum
ORDERS = (1.0, 2.0, 3.0, 0.5, 1.5)  # harmonics; half-wave lamps have halves of the first
STILL_HZ = 1.0  # light whose alias is nearer to 0 Hz is nearly static
ROUNDS, BLOCKS = 3, 12  # iterations of the phase course, and blocks of time for it
# Share that light leaves unexplained by the stamps if unconverted: overtones, motion. And the least
# share it explains by the stamps: a usual conversion's strongest tone holds most of it.
CLEAN_RATIO, MIN_BY_STAMPS = 0.015, 0.4
# At a beat of a few frames its tones look like overtones by the stamps, of which a lamp has few. A
# conversion then has to show nearly all of the light as the first harmonic.
MIN_BY_ONE = 0.9
# Least shares that a conversion explains: of the signal power by the first harmonic, by all, and of
# what the stamps leave.
MIN_FIRST, MIN_EXPLAINED, MIN_OF_REST = 0.5, 0.7, 0.5
MIN_BLENDED = 0.95  # of all power, slow waves', too: a lost frame looks a little like a blend
SAME_POWER = 1e-9
# A beat of so few frames has its tones where a lamp's overtones are: neither can be excluded.
SHORT_BEAT = 3
EDGE = 4e-3  # of a frame: nearer to the next one it is uncertain which is shown


BLENDED = "neighbouring frames are blended, as by a conversion of the frame rate or an encoder"
DOUBTFUL = "strong overtones, an encoder's beat, or frames dropped at a short beat: which?"


@dataclass(frozen=True)
class Conversion:
    """How a clip was converted.

    Attributes
    ----------
    source_hz : float
        Frame rate of the camera.
    shown_hz : float
        Frame rate of the clip.
    place : float
        Phase ``a`` of the beat, 0 to 1.
    blended : bool
        Whether neighbours are mixed; else whole frames are dropped or repeated.
    doubtful : bool
        Whether overtones of the light, or an encoder's beat, explain it as well.

    Examples
    --------
    >>> Conversion(30.0, 25.0, 0.5).taken_s(np.array([0.0, 0.04, 0.08])).round(4).tolist()
    [0.0, 0.0333, 0.0667]
    """

    source_hz: float
    shown_hz: float
    place: float
    blended: bool = False
    doubtful: bool = False

    @property
    def why_not_undone(self) -> str:
        """Why true frame times can't be recovered; '' where they can."""
        return BLENDED if self.blended else DOUBTFUL if self.doubtful else ""

    @property
    def words(self) -> str:
        """Why frame times are unreliable, for methods that don't undo it."""
        return self.why_not_undone or (
            "frames were dropped or doubled to convert the rate from "
            f"{self.source_hz:.6g} frames/s: only projection undoes that"
        )

    @property
    def source_std_hz(self) -> float:
        """Standard error of the camera's rate; 0 for a nominal one."""
        return 0.0 if self.source_hz in RATES_HZ else OFF_STD_RATIO * self.source_hz

    def source_frames(self, stamp_s: Float) -> Float:
        """Camera frames since the first one shown, before rounding down."""
        shown = np.rint(stamp_s * self.shown_hz)
        return np.asarray(shown * (self.source_hz / self.shown_hz) + self.place)

    def taken_s(self, stamp_s: Float) -> Float:
        """Times at which frames were taken, by their stamps; both since the first frame."""
        return np.asarray(np.floor(self.source_frames(stamp_s)) / self.source_hz)

    def shares(self, stamp_s: Float) -> Float:
        """Share of the following camera frame in each picture; 0 unless blended."""
        return self.source_frames(stamp_s) % 1.0 if self.blended else np.zeros(stamp_s.size)

    def seen(self, stamp_s: Float, light_rad: Float, step_rad: float) -> Complex:
        """Phasor seen of light with a phase at the frames, and a phase step to the next."""
        share = self.shares(stamp_s)
        return np.asarray(np.exp(1j * light_rad) * (1.0 - share + share * np.exp(1j * step_rad)))

    def unsure(self, stamp_s: Float) -> NDArray[np.bool_]:
        """Whether it is uncertain which frame each picture shows."""
        beyond = self.source_frames(stamp_s) % 1.0
        return np.asarray((beyond < EDGE) | (beyond > 1.0 - EDGE))


def find_conversion(
    nominals_hz: tuple[float, ...], t_s: Float, columns: Float, shown_hz: float
) -> Conversion | None:
    """Find how a time span was converted, if it was (Kay 1998).

    Parameters
    ----------
    nominals_hz : tuple of float
        Nominal frequencies of the grids whose light is sought.
    t_s : ndarray, shape (frames,)
        Time stamps since the stream's first frame.
    columns : ndarray, shape (frames, columns)
        Reduced profiles.
    shown_hz : float
        Frame rate by the stamps.
    """
    if t_s.size < BLOCKS:
        return None
    slow = _slow_waves(t_s)
    whole, noise = _parts(columns)
    least_blended = MIN_BLENDED * (float(np.sum(whole**2)) - noise)
    parts, noise = _parts(columns - slow @ (slow.T @ columns))
    total = float(np.sum(parts**2)) - noise
    if not total > 0.0:
        return None
    shown = round_rate(shown_hz)
    place = np.rint((t_s - t_s[0]) * shown).astype(np.int64)
    plain_rad = _strongest_tone(parts, t_s, place, shown)
    still = _nearly_still(parts, place, shown)
    by_stamps = max(_explained(parts, slow, plain_rad, partial(_by_stamps, place % 2)), still)
    by_one = max(_explained(parts, slow, plain_rad, lambda rad: [np.exp(1j * rad)]), still)
    unexplained, is_clean = total - by_stamps, by_stamps > (1.0 - CLEAN_RATIO) * total
    if by_stamps < MIN_BY_STAMPS * total or (is_clean and by_one > MIN_BY_ONE * total):
        return None
    least_first = MIN_FIRST * total
    best, found = max(MIN_EXPLAINED * total, by_stamps + MIN_OF_REST * unexplained), None
    if is_clean:
        least_first = max(MIN_BY_ONE * total, by_one + MIN_OF_REST * (total - by_one))
        best = by_stamps
    for source_hz, blended, nominal_hz in product(RATES_HZ, (False, True), nominals_hz):
        ratio = source_hz / shown
        if abs(ratio - max(round(ratio), 1)) < SAME_RATE_RATIO:
            continue  # a whole ratio: no beat
        if is_clean and (blended or source_hz < shown):
            continue
        tries = [Conversion(source_hz, shown, k / PLACES, blended) for k in range(PLACES)]
        power, _ = _first_harmonic(parts, t_s, place, tries, nominal_hz)
        if power.max() < least_first:
            continue
        near = tries[_middle_of_best(power)]
        for off in OFF_RATIO:
            tries = _around(near, off, float(place.mean()))
            power, hz = _first_harmonic(parts, t_s, place, tries, nominal_hz)
            top = _middle_of_best(power)
            light_rad = 2.0 * np.pi * hz[top] * tries[top].taken_s(t_s)
            waves_of = partial(_converted, tries[top], t_s, hz[top])
            fitted = (whole, slow[:, :0]) if blended else (parts, slow)
            explained = _explained(*fitted, light_rad, waves_of)
            if blended and explained < least_blended:
                continue
            # A deviating rate has to explain clearly more than a nominal one.
            if explained > best + (MIN_OF_REST * (total - best) if off and found else 0.0):
                best, found = explained, tries[top]
    is_short = found and not found.blended and _beat_frames(found) <= SHORT_BEAT
    return replace(found, doubtful=bool(is_short)) if found else None


def _middle_of_best(power: Float) -> int:
    """Index of the best place; the middle one where a short beat makes several equal."""
    same = np.flatnonzero(power > (1.0 - SAME_POWER) * power.max())
    return int(same[same.size // 2])


def _beat_frames(found: Conversion) -> int:
    """Period of the nominal rates' beat, in frames shown."""
    source_hz, shown_hz = (
        min(RATES_HZ, key=lambda usual: abs(usual - rate_hz))
        for rate_hz in (found.source_hz, found.shown_hz)
    )
    return Fraction(source_hz / shown_hz).limit_denominator(1000).denominator


def round_rate(rate_hz: float) -> float:
    """Return the usual rate within 0.03 % of a measured one, else the measured one.

    Examples
    --------
    >>> round(round_rate(29.969), 3), round_rate(27.0)
    (29.97, 27.0)
    """
    nearest = min(RATES_HZ, key=lambda usual: abs(usual - rate_hz))
    return nearest if abs(nearest - rate_hz) < 3e-4 * rate_hz else rate_hz


def _parts(columns: Float) -> tuple[Float, float]:
    """Principal components of the pictures' change over time, and the noise power in them."""
    change = columns - columns.mean(axis=0)
    power, shape = np.linalg.eigh(change.T @ change)
    kept = min(PARTS, power.size)
    parts = change @ shape[:, -kept:]
    noise = float(np.median(power)) * kept if power.size > 2 * kept else 0.0
    return parts, noise


def _strongest_tone(parts: Float, t_s: Float, place: NDArray[np.int64], shown_hz: float) -> Float:
    """Phase of the strongest tone by the stamps, at any frequency, shape (frames,)."""
    size = PADDED * (int(place[-1]) + 1)
    held = np.zeros((parts.shape[1], int(place[-1]) + 1))
    held[:, place] = parts.T
    power = np.sum(np.abs(np.fft.rfft(held, size)) ** 2, axis=0)
    return np.asarray(2.0 * np.pi * power.argmax() * shown_hz / size * t_s)


def _nearly_still(parts: Float, place: NDArray[np.int64], shown_hz: float) -> float:
    """Power near 0 Hz and half the frame rate, by the stamps.

    Of cosines (DCT-II), which a drift's two ends don't leak into as they do in a Fourier transform.
    """
    frames = int(place[-1]) + 1
    lines = np.arange(int(2.0 * STILL_HZ * frames / shown_hz))
    waves = np.sqrt(2.0 / frames) * np.cos(np.pi / frames * (place + 0.5)[:, None] * lines)
    waves[:, :1] *= np.sqrt(0.5)
    return float(np.sum((np.hstack([parts, parts * (-1.0) ** place[:, None]]).T @ waves) ** 2))


def _around(near: Conversion, off_ratio: float, middle: float) -> list[Conversion]:
    """Conversions from a slightly different rate, with nearly the same place in mid-span.

    All places between two steps of the beat are equivalent for a nominal rate, not for others.
    """
    moved = near.place - off_ratio * near.source_hz / near.shown_hz * middle
    reach = max(1.0 / _beat_frames(near), 1.0 / PLACES)
    return [
        replace(near, source_hz=near.source_hz * (1.0 + off_ratio), place=float(place % 1.0))
        for place in moved + np.linspace(-reach, reach, FINE)
    ]


def _first_harmonic(
    parts: Float, t_s: Float, place: NDArray[np.int64], tries: list[Conversion], nominal_hz: float
) -> tuple[Float, Float]:
    """Power and frequency (Hz) of the light's first harmonic under each conversion."""
    shown_hz = tries[0].shown_hz
    size = PADDED * (int(place[-1]) + 1)
    turn = np.array([
        one.seen(t_s, 4.0 * np.pi * nominal_hz * one.taken_s(t_s),
                 4.0 * np.pi * nominal_hz / one.source_hz)
        for one in tries
    ])  # fmt: skip
    power: Float = np.zeros((len(tries), size))
    for part in parts.T:
        held = np.zeros((len(tries), int(place[-1]) + 1), np.complex128)
        held[:, place] = turn.conj() * part
        power += np.abs(np.fft.fft(held, size)) ** 2
    reach = max(int(OFFSETS_HZ * size / shown_hz), 1)
    near = np.concatenate([power[:, -reach:], power[:, : reach + 1]], axis=1)
    top = near.argmax(axis=1)
    offset_hz = (top - reach) * shown_hz / size
    heard = np.sum(np.abs(turn) ** 2, axis=1)
    return 2.0 * near[np.arange(top.size), top] / heard, 2.0 * nominal_hz + offset_hz


def _converted(how: Conversion, stamp_s: Float, hz: float, light_rad: Float) -> list[Complex]:
    """Phasors of converted light, harmonic by harmonic."""
    step_rad = 2.0 * np.pi * hz / how.source_hz
    return [how.seen(stamp_s, order * light_rad, order * step_rad) for order in ORDERS]


def _by_stamps(odd: NDArray[np.int64], light_rad: Float) -> list[Complex]:
    """Phasors of light by its alias, which defines half orders only up to half the frame rate."""
    waves = [np.exp(1j * order * light_rad) for order in ORDERS]
    other = 1.0 - 2.0 * odd
    return [*waves, *(w * other for w, order in zip(waves, ORDERS, strict=True) if order % 1.0)]


def _slow_waves(t_s: Float) -> Float:
    """Cosines below 1 Hz, orthonormal, shape (frames, waves): changes of the scene."""
    span_s = t_s[-1] - t_s[0]
    half_turns = np.arange(int(2.0 * STILL_HZ * span_s) + 1) / span_s
    return np.asarray(np.linalg.qr(np.cos(np.pi * (t_s - t_s[0])[:, None] * half_turns))[0])


def _explained(
    parts: Float, slow: Float, light_rad: Float, waves_of: Callable[[Float], list[Complex]]
) -> float:
    """Power that light explains, whose phase is nearly known; its first harmonic's waves first.

    Slow waves were taken from the parts before, and are from the light's waves, too.
    """
    x = np.linspace(-1.0, 1.0, light_rad.size)
    explained = 0.0
    for _ in range(ROUNDS):
        first, *others = waves_of(light_rad)
        waves = np.column_stack([f for w in (first, *others) for f in (w.real, w.imag)])
        waves -= slow @ (slow.T @ waves)
        share = np.linalg.lstsq(waves, parts, rcond=1e-6)[0]
        explained = float(np.sum(parts**2) - np.sum((parts - waves @ share) ** 2))
        # Follow the first harmonic's phase, since the grid drifts.
        fundamental = parts - waves[:, 2:] @ share[2:]
        light = (fundamental @ (share[0] + 1j * share[1])) * first.conj()
        blocks = np.array_split(np.arange(x.size), BLOCKS)
        phase = np.unwrap([float(np.angle(light[block].sum())) for block in blocks])
        light_rad = light_rad + np.polyval(np.polyfit([x[b].mean() for b in blocks], phase, 3), x)
    return explained
