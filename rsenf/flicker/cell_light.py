"""Statistics of picture cells: is a periodic signal one light, and does it multiply or add?

The picture is cut into cells: bands of rows in each strip. The cells' complex amplitudes at a given
phase are fitted by *texture × phase ramp down the rows × smooth complex shares* (:func:`light_of`),
the model of one light, and by the same without texture, that of a pattern added to the picture.
Also measured are the turns of the ramp, and the phase's deviation from a single ramp.
:mod:`rsenf.flicker.mains` decides from these.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import alias_hz

Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

BANDS = 24
ORDER = 2  # degree of the polynomials of place for a light's share
# Offsets from the phase, in turns over the window, at which noise is measured.
BESIDE = np.array([m for m in range(-8, 9) if abs(m) >= 3])
TURNS_STEP = 0.05
GROUP, LINES = 4, 3  # bands averaged for a phase; fewest phases, and iterations, of a line fit
# Farther than this from 0 Hz and half the frame rate, a tone and its mirror image are separable.
APART_HZ = 0.5
BRIEF_S = 8.0  # shorter windows seldom show whether a phase wanders
# Frames after which an encoder's types may repeat, and the farthest image from a multiple of their
# rate: light that hardly moves. And where a ramp and its reverse are too much alike.
TYPES, NEAR_BEAT_HZ, MOST_ALIKE = range(3, 13), 0.3, 0.25
# Ratios of unexplained shares: with over without texture, above which a pattern is added (no light
# exceeds it); without over with, above which light multiplies. And the least unexplained shares.
ADDED, MULTIPLIED = 1.5, 2.0
LEAST_ADDED, LEAST_MULTIPLIED = 0.04, 0.02


@dataclass(frozen=True, kw_only=True)
class CellLight:
    """What the cells show of the signal at a given phase.

    Attributes
    ----------
    turns : float
        Phase turns down the rows of a frame.
    explained, explained_std : float
        Share of the signal's power that one light explains (texture × ramp × smooth shares), and
        its standard error.
    added : float
        Share that a pattern added to the picture explains: the same model without texture.
    snr : float
        Power in the light model over that of noise in it.
    hz_std : float
        Cramér-Rao bound of its frequency, for this SNR and duration.
    apart_turns : float
        Rms deviation of the phase from one ramp that all strips share: not 0 where the light of
        several lamps with different phases mixes unevenly.
    in_phase : float
        Share of the signal's power with the phase of one ramp, whatever the amplitudes of the
        cells.
    is_brief : bool
        Whether the window is shorter than ``BRIEF_S``.
    image : float
        Share of the tone that has an equal image, as of :func:`image_of`.
    """

    turns: float
    explained: float
    explained_std: float
    added: float
    snr: float
    hz_std: float
    apart_turns: float
    in_phase: float
    is_brief: bool
    image: float = 0.0

    @property
    def is_added(self) -> bool:
        """Whether it is more likely a pattern added to the picture than light."""
        unexplained = 1.0 - self.explained
        least = max(LEAST_ADDED, 3.0 * self.explained_std)
        return unexplained > max(ADDED * (1.0 - self.added), least)

    @property
    def is_multiplied(self) -> bool:
        """Whether it is shown to multiply bright and dark texture, not merely not excluded."""
        least = max(LEAST_MULTIPLIED, 3.0 * self.explained_std)
        return 1.0 - self.added > max(MULTIPLIED * (1.0 - self.explained), least)


def tells_cells(f0_hz: float, frame_rate_hz: float) -> bool:
    """Whether the alias is far enough from 0 Hz and half the rate to exclude its mirror image."""
    seen_hz = abs(alias_hz(f0_hz, frame_rate_hz))
    return APART_HZ <= seen_hz <= frame_rate_hz / 2.0 - APART_HZ


def bands_of(rows: int) -> int:
    """Number of bands for a number of rows."""
    return min(rows, BANDS)


@functools.lru_cache(maxsize=8)
def _bands(rows: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    """First row of each band, and one over its number of rows."""
    edges = np.linspace(0, rows, bands_of(rows) + 1).astype(np.intp)
    return edges[:-1], (1.0 / np.diff(edges)[:, None]).astype(np.float32)


def cell_means(level: NDArray[Any]) -> NDArray[Any]:
    """Mean level of each cell, (frames, bands, strips), of rows, (frames, rows, strips)."""
    starts, share = _bands(level.shape[1])
    means = np.add.reduceat(level, starts, axis=1)
    means *= share
    return means


def look_at(
    cells: NDArray[np.floating],
    t_s: Float,
    phase_rad: Float,
    bands: int,
    f0_hz: float,
    frame_rate_hz: float,
) -> CellLight:
    """Analyse the cells' signal at a phase, by the estimator that suits the alias.

    :func:`light_of` where :func:`tells_cells`, else :func:`still_light_of`.

    Parameters
    ----------
    cells, t_s, phase_rad, bands
        As for :func:`light_of`.
    f0_hz, frame_rate_hz : float
        Frequency of the tracked harmonic; frame rate.
    """
    if not tells_cells(f0_hz, frame_rate_hz):
        return still_light_of(cells, t_s, phase_rad, bands, f0_hz / frame_rate_hz)
    seen = cells.astype(np.float64)
    level, tone, beside = _tones(seen, t_s, phase_rad)
    light = _light(level, tone, beside, bands, f0_hz / frame_rate_hz, t_s)
    # Off the nearest multiple of the rate of an encoder's frame types.
    alias, beats = alias_hz(f0_hz, frame_rate_hz), ((j, k) for k in TYPES for j in range(1, k))
    rates_hz = (frame_rate_hz * j / k for j, k in beats if 2 * j != k)
    off_hz = min((math.remainder(alias - hz, frame_rate_hz) for hz in rates_hz), key=abs)
    if abs(off_hz) > NEAR_BEAT_HZ:
        return light
    _, image, _ = _tones(seen, t_s, 4.0 * np.pi * (f0_hz - off_hz) * t_s - phase_rad)
    return dataclasses.replace(
        light, image=image_of(level, tone, beside, image, light.turns, bands)
    )


def image_of(
    level: Float, tone: Complex, beside: Complex, image: Complex, turns: float, bands: int
) -> float:
    """Share of a tone that has an equal image, mirrored about a fraction of the frame rate.

    An encoder's frame types repeat every few frames. What they do to light that hardly moves from
    frame to frame is a product of two real waves: two tones, one on either side of a multiple of
    the types' rate, and their ramps are reversed. Light that turns by itself has no such image. 0
    where its ramp and the reverse are too much alike.

    Parameters
    ----------
    level, tone, image : ndarray, shape (cells,)
        Mean levels, and complex amplitudes of the tone and at its mirror image.
    beside : ndarray, shape (beside, cells)
        Noise.
    turns : float
        Phase turns down the rows.
    bands : int
    """
    by_band = np.sum(level.reshape(bands, -1) ** 2, axis=1)
    ramp = np.exp(2j * np.pi * turns * (np.arange(bands) + 0.5) / bands)
    if abs(by_band @ ramp**2) > MOST_ALIKE * by_band.sum():
        return 0.0
    power = max(float(_power(tone)), float(_power(image))) - float(_power(beside).mean())
    return float(np.abs(tone @ image)) / max(power, 1e-9)


def light_of(
    cells: NDArray[np.floating], t_s: Float, phase_rad: Float, bands: int, most_turns: float
) -> CellLight:
    """Analyse the cells' signal at a phase; level and linear drift are removed first.

    Parameters
    ----------
    cells : ndarray, shape (frames, bands · strips)
        Cell means, as of :func:`cell_means`.
    t_s, phase_rad : ndarray, shape (frames,)
        Times, and phase of the tracked harmonic.
    bands : int
    most_turns : float
        Turns of that harmonic for a read-out over the whole frame period.
    """
    level, tone, beside = _tones(cells.astype(np.float64), t_s, phase_rad)
    return _light(level, tone, beside, bands, most_turns, t_s)


def still_light_of(
    cells: NDArray[np.floating], t_s: Float, phase_rad: Float, bands: int, most_turns: float
) -> CellLight:
    """Analyse the cells' signal at a phase that hardly turns: fitted jointly with the texture.

    Parameters
    ----------
    cells : ndarray, shape (bins, bands · strips)
        Cell means over time bins.
    t_s, phase_rad : ndarray, shape (bins,)
    bands : int
    most_turns : float
    """
    waves = np.column_stack([np.ones_like(t_s), np.cos(phase_rad), np.sin(phase_rad)])
    (level, cosine, sine), *_ = np.linalg.lstsq(waves, cells, rcond=None)
    residual = cells - waves @ np.array([level, cosine, sine])
    beside = _tones(residual, t_s, phase_rad)[2]
    return _light(level, cosine - 1j * sine, beside, bands, most_turns, t_s)


def _light(
    level: Float, tone: Complex, beside: Complex, bands: int, most_turns: float, t_s: Float
) -> CellLight:
    """Derive the statistics from levels (cells,), tones (cells,) and noise (beside, cells).

    Cells are weighted by 1/σ, with the median variance added so that none dominates.
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
    tone_power = max(float(_power(tone) - _power(beside).mean()), 1e-9)

    def explained(basis: Complex) -> tuple[float, float]:
        """Share of the signal's power that a basis explains, and its power over the noise's."""
        axes, _ = np.linalg.qr(basis.reshape(len(basis), -1).T)
        power, noises = (_power(of @ axes.conj()) for of in (tone, beside))
        return float(power - noises.mean()) / tone_power, float(power / max(noises.mean(), 1e-9))

    straight = level * ramp.conj()
    by_light, snr = explained(shares * (ramp * level))
    # With a single strip the texture can't tell an added pattern from light.
    return CellLight(
        turns=turns,
        explained=by_light,
        explained_std=float(_power(beside).std()) / tone_power,
        added=explained(shares * evenly)[0] if shape[1] > 1 else by_light,
        snr=snr,
        hz_std=float(np.sqrt(6.0 / max(snr, 1e-9)) / (2.0 * np.pi * (t_s[-1] - t_s[0]))),
        apart_turns=_apart_turns(
            tone.reshape(shape) * straight, beside.reshape(-1, *shape) * straight, place
        ),
        in_phase=_in_phase(tone.reshape(shape) * ramp.conj(), beside, place),
        is_brief=bool(np.rint(t_s[-1] - t_s[0]) < BRIEF_S),
    )


def _apart_turns(light: Complex, noise: Complex, place: Float) -> float:
    """Rms deviation of a light's phase, (bands, strips), from a line down the rows, less noise.

    Noise has the shape (beside, bands, strips).
    """
    starts = np.arange(0, place.size, GROUP)
    light, noise = (np.add.reduceat(x, starts, axis=-2) for x in (light, noise))
    if len(starts) < LINES or not np.abs(light.sum()) > 0.0:
        return 0.0
    weight = np.abs(light) ** 2
    middle = np.add.reduceat(place, starts) / np.diff(np.append(starts, place.size))
    light = _in_line(light, middle)
    var_rad2 = np.sum(weight * np.angle(light) ** 2) - np.sum(np.abs(noise) ** 2) / len(noise) / 2.0
    return float(np.sqrt(max(var_rad2 / np.sum(weight), 0.0))) / (2.0 * np.pi)


def _in_phase(tone: Complex, beside: Complex, place: Float) -> float:
    """Share of a tone, (bands, strips), in phase with one line down the rows.

    Amplitudes don't matter: a codec suppresses the flicker of some blocks.
    """
    if not np.abs(tone.sum()) > 0.0:
        return 0.0
    tone = _in_line(tone, place)
    noise = float(_power(beside.reshape(len(beside), -1)).mean())
    along = float(np.sum(tone.real * np.abs(tone.real)))
    return along / max(float(np.sum(np.abs(tone) ** 2)) - noise / 2.0, 1e-9)


def _in_line(light: Complex, place: Float) -> Complex:
    """Return a light, (bands, strips), without the line down the rows that fits its phase best."""
    weight = np.abs(light) ** 2
    down = np.broadcast_to((place - place.mean())[:, None], light.shape)
    for _ in range(LINES):
        light = light / np.exp(1j * np.angle(light.sum()))
        slope = np.sum(weight * down * np.angle(light)) / np.sum(weight * down**2)
        light = light * np.exp(-1j * slope * down)
    return light


def _tones(cells: Float, t_s: Float, phase_rad: Float) -> tuple[Float, Complex, Complex]:
    """Mean levels, tones at the phase, and tones beside it: (cells,), (cells,), (beside, cells).

    Under a Hann window, with linear drift removed.
    """
    x = (t_s - t_s[0]) / (t_s[-1] - t_s[0]) - 0.5
    weight = np.cos(np.pi * x) ** 2
    weight /= weight.sum()
    line = x - weight @ x
    level = weight @ cells
    residual = cells - level - np.outer(line, (weight * line) @ cells / ((weight * line) @ line))
    angle = phase_rad[:, None] + 2.0 * np.pi * np.append(0, BESIDE) * x[:, None]
    cosine, sine = (weight[:, None] * wave for wave in (np.cos(angle), np.sin(angle)))
    tones = 2.0 * (cosine.T @ residual - 1j * (sine.T @ residual))
    return level, tones[0], tones[1:]


def _turns(tone: Complex, place: Float, most: float) -> float:
    """Turns down the rows of largest power, with a free phase in each strip."""
    half = np.ceil(most / TURNS_STEP)
    turns = np.arange(-half, half + 1) * TURNS_STEP
    return float(turns[np.argmax(_power(np.exp(-2j * np.pi * np.outer(turns, place)) @ tone))])


def _shares(place: Float, strips: int) -> Float:
    """Polynomials of place over the picture, shape (shares, bands, strips)."""
    down = (2.0 * place - 1.0)[:, None]
    across = np.linspace(-1.0, 1.0, strips)[None, :] if strips > 1 else np.zeros((1, 1))
    orders = [(i, j) for i in range(ORDER + 1) for j in range(min(ORDER - i, strips - 1) + 1)]
    return np.array([down**i * across**j for i, j in orders])


def _power(tone: Complex) -> Float:
    return np.asarray(np.sum(np.abs(tone) ** 2, axis=-1))
