"""The paper's line model: frequencies and amplitudes of the flicker's lines in the row series.

The row series is the rows of all frames one after the other, ``F_r·L`` samples a second. A camera
without an idle period would read ``M`` rows in a frame period (the *capacity*); it reads ``L`` of
them. Dropping the others and closing the gaps is an ``L``-branch polyphase filter bank. Its output
spectrum is a sum of shifted copies of the input's, each weighted by a gain ``F_m`` (Eq. 7).

Light of frequency ``f_0`` and harmonics ``k`` has lines at ``k·f_0 − m·F_r`` for every integer
``m`` (Eqs. 12 and 19, ``Eq_Case1_f`` and ``Eq_Case2_f``: ``m`` below and above 0). Their amplitude
is ``M/L·|F_m|``: the gain at that frequency, times ``M/L`` as Eq. 6 compresses the frequency axis,
which raises lines. With ``c = k·f_0·ρ/F_r`` this is

    |sin(π(c − m)) / (L·sin(π(c − m)/L))|  →  |sinc(c − m)|   for many rows.

The paper neglects two things:

* A line below 0 Hz appears at its absolute value. The bound ``m < f_0/F_r`` (Eq. 20, ``Eq_S2``)
  drops these folded lines, as does ``folded=False``.
* Lines of equal frequency add as complex numbers, so that their sum depends on the light's phase.
  If ``F_r`` divides ``2·f_0``, every line is such a sum. Lines at 0 Hz merge with the steady light
  and are never listed.

Equations of the paper (Vatansever, Dirik and Memon, IEEE TIFS 2019) are numbered here and in the
other files of the line model by their order in the manuscript: ``F_m`` is Eq. 7 (label ``Fm``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rsenf.errors import UsageError
from rsenf.model.grid import FloatArray
from rsenf.model.light import rectified_cosine

ComplexArray = NDArray[np.complex128]
ROWS = 720
COSINE = (1.0,)
RECTIFIED = (1.0, *rectified_cosine(8).harmonic_ratios)  # |cos|, the paper's: 1, −1/5, 3/35, …
_SAME_HZ = 1e-6  # lines nearer to each other are one
PHASES_RAD: FloatArray = np.linspace(0, 2 * math.pi, 2048, endpoint=False)


def branch_gain(omega: ArrayLike, m: ArrayLike, rows: int, capacity: float) -> ComplexArray:
    """Gain ``F_m(ω)`` of the ``m``-th shifted copy, the sum of Eq. 7 (``Fm``) in closed form.

    Parameters
    ----------
    omega : array_like of float
        Angular frequency of the output, radians per row.
    m : array_like of int
        Index of the copy; broadcast with ``omega``.
    rows : int
        ``L``, rows of a frame.
    capacity : float
        ``M``, rows that would fit in a frame period; needn't be an integer.

    Returns
    -------
    ndarray of complex128

    Examples
    --------
    >>> abs(branch_gain(0.0, 0, 540, 720.0)).item()
    0.75
    """
    step = np.asarray(
        (np.asarray(omega) * (capacity - rows) + 2 * math.pi * np.asarray(m)) / capacity
    )
    whole = np.abs(np.sin(step / 2)) < 1e-12  # all terms of the sum are equal
    half = np.where(whole, 1.0, step / 2)
    total = np.where(whole, rows, np.sin(rows * half) / np.sin(half))
    turn = np.where(whole, 1.0, np.exp(-1j * half * (rows - 1)))
    return np.asarray(total * turn / capacity, np.complex128)


@dataclass(frozen=True)
class Part:
    """One of the lines that coincide at a frequency."""

    harmonic: int  # k, of the light
    m: int  # at k·f_0 − m·F_r
    turns: int  # multiple of the light's phase in its own: k, or −k if folded
    gain: complex  # complex amplitude when that phase is 0


@dataclass(frozen=True)
class SpectralLine:
    """A line of the row series, relative to harmonic 1 of the light.

    ``amplitude`` is the rms over all phases of the light, which is simply the amplitude of a line
    of one part. ``harmonic`` and ``m`` are those of the strongest part.
    """

    freq_hz: float
    amplitude: float
    harmonic: int
    m: int
    parts: tuple[Part, ...]

    def at_phase(self, phase_rad: ArrayLike) -> FloatArray:
        """Amplitude for given phases of the light's harmonic 1 at the start of a frame."""
        phase = np.asarray(phase_rad)
        total = sum(p.gain * np.exp(1j * p.turns * phase) for p in self.parts)
        return np.asarray(np.abs(total), np.float64)

    def amplitude_range(self) -> tuple[float, float]:
        """Smallest and largest amplitude over all phases of the light."""
        if len(self.parts) == 1:
            return self.amplitude, self.amplitude
        sizes = self.at_phase(PHASES_RAD)
        return float(sizes.min()), float(sizes.max())


def lines(
    frame_rate_hz: float,
    f0_hz: float,
    idle_ratio: float,
    *,
    rows: int = ROWS,
    harmonics: Sequence[complex] = COSINE,
    exposure_s: float = 0.0,
    folded: bool = True,
    top_hz: float = math.inf,
) -> tuple[SpectralLine, ...]:
    """List the lines of the row series, the strongest first (paper, Eq. 21, with the folded lines).

    Parameters
    ----------
    frame_rate_hz : float
        ``F_r``.
    f0_hz : float
        Illumination frequency, twice the grid's.
    idle_ratio : float
        ``ρ``, from 0 to less than 1.
    rows : int, optional
        ``L``; lines are below ``F_r·L/2``.
    harmonics : sequence of complex, optional
        Amplitudes of the light's harmonics 1, 2, … with phases at the crest of harmonic 1:
        ``COSINE``, ``RECTIFIED``, a part of these, or :meth:`rsenf.model.Light.series`.
    exposure_s : float, optional
        ``T_e``: multiplies harmonic ``k`` by ``sinc(k·f_0·T_e)`` and delays it by ``T_e/2``.
    folded : bool, optional
        False drops the lines below 0 Hz, as Eq. 20 (``Eq_S2``) does.
    top_hz : float, optional
        List lines below this frequency only.

    Raises
    ------
    UsageError
        When a value is outside its range.

    Examples
    --------
    >>> [(round(line.freq_hz), round(line.amplitude, 3)) for line in lines(30.0, 100.0, 0.45)[:2]]
    [(70, 0.637), (40, 0.637)]
    """
    if not (frame_rate_hz > 0 and f0_hz > 0 and rows >= 2 and exposure_s >= 0):
        raise UsageError("frame rate, illumination frequency, rows and exposure must be positive")
    if not 0 <= idle_ratio < 1:
        raise UsageError(f"an idle ratio of {idle_ratio:g} is not from 0 to less than 1")
    top_hz = min(top_hz, frame_rate_hz * rows / 2)
    found: list[tuple[float, Part]] = []
    for k, size in enumerate(harmonics, 1):
        blur = np.sinc(k * f0_hz * exposure_s) * np.exp(1j * math.pi * k * f0_hz * exposure_s)
        found += _of_harmonic(k, size * blur, frame_rate_hz, f0_hz, idle_ratio, rows, top_hz)
    together = _together(part for part in found if folded or part[1].turns > 0)
    return tuple(sorted(together, key=lambda line: -line.amplitude))


def _of_harmonic(
    k: int,
    size: complex,
    frame_rate_hz: float,
    f0_hz: float,
    idle_ratio: float,
    rows: int,
    top_hz: float,
) -> list[tuple[float, Part]]:
    """Frequency and part of every line of one harmonic between 0 Hz and ``top_hz``."""
    per_frame, span = k * f0_hz / frame_rate_hz, min(top_hz / frame_rate_hz, rows / 2)
    m = np.arange(math.ceil(per_frame - span), math.floor(per_frame + span) + 1)
    signed_hz = k * f0_hz - m * frame_rate_hz
    inside = (np.abs(signed_hz) > _SAME_HZ) & (np.abs(signed_hz) < top_hz)
    m, signed_hz = m[inside], signed_hz[inside]
    capacity = rows / (1 - idle_ratio)
    omega = 2 * math.pi * signed_hz / (frame_rate_hz * rows)
    gain = size * branch_gain(omega, -m, rows, capacity) * (capacity / rows)
    return [
        (abs(hz), Part(k, number, k, g) if hz > 0 else Part(k, number, -k, g.conjugate()))
        for hz, number, g in zip(signed_hz.tolist(), m.tolist(), gain.tolist(), strict=True)
    ]


def _together(found: Iterable[tuple[float, Part]]) -> Iterator[SpectralLine]:
    """Merge coinciding parts into lines."""
    last_hz, parts = -math.inf, list[Part]()
    for freq_hz, part in [*sorted(found, key=lambda f: f[0]), (math.inf, None)]:
        if parts and freq_hz - last_hz > _SAME_HZ:
            chief = max(parts, key=lambda p: abs(p.gain))
            amplitude = math.sqrt(sum(abs(p.gain) ** 2 for p in parts))
            yield SpectralLine(last_hz, amplitude, chief.harmonic, chief.m, tuple(parts))
            parts = []
        last_hz = freq_hz
        if part is not None:
            parts.append(part)
