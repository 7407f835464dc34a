"""What cells of the picture show of a light: is it one, and does it multiply or add?

The picture is cut into cells, some bands of rows in each strip. Of what turns with a phase it is
asked how much is *one light with smooth shares in the picture* (:func:`light_of`), with the
texture and without it, how many turns it makes down the rows, and how far it strays from one ramp.
:mod:`rsenf.flicker.mains` decides by that.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import alias_hz

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
BRIEF_S = 8.0  # shorter windows seldom tell whether a phase wanders
# A pattern that is added leaves so much less unexplained without the texture, and no light does;
# light that shows on bright and dark leaves so much less with it. Below a share neither counts.
ADDED, MULTIPLIED = 1.5, 2.0
LEAST_ADDED, LEAST_MULTIPLIED = 0.04, 0.02


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
    in_phase : float
        Share of it that has the phase of that ramp, however much of it each cell shows.
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
    in_phase: float
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
        in_phase=_in_phase(tone.reshape(shape), beside.reshape(-1, *shape), ramp, place),
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


def _in_phase(tone: Complex, beside: Complex, ramp: Complex, place: Float) -> float:
    """Share of what turns, (bands, strips), that has the phase of one line down the rows.

    However much of it each cell shows: a codec keeps the flicker of some blocks back.
    """
    straight = tone * ramp.conj()
    line = np.ones_like(ramp)
    down = (place - place.mean())[:, None]
    for _ in range(LINES):
        now = straight * line.conj()
        middle = np.exp(1j * np.angle(now.sum()))
        now = now * middle.conj()
        weight = np.abs(now) ** 2
        slope = np.sum(weight * down * np.angle(now)) / np.sum(weight * down**2)
        line = line * middle * np.exp(1j * slope * down)
    now = straight * line.conj()
    noise = float(_power(beside.reshape(len(beside), -1)).mean())
    with_it = float(np.sum(now.real * np.abs(now.real)))
    return (with_it) / max(float(np.sum(np.abs(now) ** 2)) - noise / 2.0, 1e-9)


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
