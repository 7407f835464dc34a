"""Projects rows onto what flicker can be down the rows: a few values a frame.

Concatenating the rows of all frames without the time between frames (the paper's row-luminance
series, at ``F_r·L`` samples/s) replaces the line at ``k·f_0`` by lines at ``k·f_0 + m·F_r`` (paper,
Eq. 21, ``Shifted_ENF``). The Fourier sum of that series at ``f_y`` splits into frames: within a
frame it projects the row profile onto a phase ramp of ``f_y/F_r`` turns; from frame to frame every
line of the harmonic advances by the same phase, that of ``k·f_0`` itself. So one small matrix
product per frame gives the slow-time series (one value a frame) of all lines, without
concatenation, interpolation or a long FFT.

:class:`ProfileBasis` needs no known read-out time: ramps, and the scene's reflectance that
modulates them, are smooth, so a few cosines and sines down the rows represent them. These are real
and orthogonal, so that white noise of the rows stays white, and a tone's mirror image at the
negative frequency shows by its ramp the other way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock

# Nearer to half the frame rate than this a tone and its mirror image look alike in the frames.
MIRRORED_HZ = 1.0
# Standard deviation of the illumination frequency, large for a grid; and log odds at which the more
# usual of two deviations counts as known.
USUAL_HZ, SURE_LOG_ODDS = 0.04, 7.0


@dataclass(frozen=True)
class Line:
    """A hypothesis: this line of this harmonic of this grid.

    Parameters
    ----------
    nominal_hz : float
        Nominal grid frequency; the illumination's is twice that.
    harmonic : int
        Harmonic ``k`` of the illumination frequency.
    m : int
        Line number ``m`` (paper, Eq. 21); negative numbers are its second case.

    Examples
    --------
    >>> line = Line(50.0, 1, -3)
    >>> round(line.line_hz(29.97), 2), round(line.alias_hz(29.97), 2), round(line.turns(29.97), 3)
    (10.09, 10.09, 0.337)
    """

    nominal_hz: float
    harmonic: int
    m: int

    @property
    def carrier_hz(self) -> float:
        """Return the harmonic's nominal frequency, ``k·f_0``."""
        return 2.0 * self.nominal_hz * self.harmonic

    def line_hz(self, frame_rate_hz: float) -> float:
        """Frequency in the concatenated rows' spectrum, ``f_y = k·f_0 + m·F_r`` (paper, Eq. 21)."""
        return self.carrier_hz + self.m * frame_rate_hz

    def alias_hz(self, frame_rate_hz: float) -> float:
        """Return the alias at the frame rate, within ± half the rate."""
        return alias_hz(self.carrier_hz, frame_rate_hz)

    def turns(self, frame_rate_hz: float) -> float:
        """Turns of phase down the rows of one frame, ``f_y / F_r``."""
        return self.line_hz(frame_rate_hz) / frame_rate_hz


def mirror_hz(nominal_hz: float, frame_rate_hz: float) -> float:
    """Return the frequency about which light is mirrored, if its alias is near half the rate.

    There both senses of rotation look the same from frame to frame; NaN elsewhere.

    Parameters
    ----------
    nominal_hz, frame_rate_hz : float

    Examples
    --------
    >>> mirror_hz(60.0, 80.0), mirror_hz(50.0, 30.0)
    (120.0, nan)
    """
    double_hz = 4.0 * nominal_hz
    apart_hz = alias_hz(double_hz, frame_rate_hz)
    return (double_hz - apart_hz) / 2.0 if abs(apart_hz) < MIRRORED_HZ else float("nan")


def usual_log_odds(off_hz: float, other_off_hz: float) -> float:
    """Log odds of the first of two deviations of the illumination from its nominal frequency.

    Parameters
    ----------
    off_hz, other_off_hz : float
    """
    return (other_off_hz**2 - off_hz**2) / (2.0 * USUAL_HZ**2)


def alias_hz(carrier_hz: float, frame_rate_hz: float) -> float:
    """Return the alias of a frequency at the frame rate, within ± half the rate.

    Parameters
    ----------
    carrier_hz, frame_rate_hz : float

    Examples
    --------
    >>> alias_hz(100.0, 30.0), alias_hz(200.0, 30.0), alias_hz(100.0, 25.0)
    (10.0, -10.0, 0.0)
    """
    return (carrier_hz + frame_rate_hz / 2) % frame_rate_hz - frame_rate_hz / 2


def candidate_lines(
    nominal_hz: float, harmonic: int, frame_rate_hz: float, rows: int
) -> tuple[Line, ...]:
    """Lines the paper searches: ``0 < k·f_0 + m·F_r ≤ 2·k·f_0``, the nearest to ``k·f_0`` first.

    One mean per frame has no ramp down the rows: only ``m = 0`` is left, the alias that Garg et al.
    (2011) use.

    Parameters
    ----------
    nominal_hz : float
    harmonic : int
    frame_rate_hz : float
    rows : int

    Examples
    --------
    >>> [line.m for line in candidate_lines(50.0, 1, 29.97, 720)]
    [0, -1, 1, -2, 2, -3, 3]
    """
    if rows == 1:
        return (Line(nominal_hz, harmonic, 0),)
    carrier_hz = 2.0 * nominal_hz * harmonic
    reach = int(carrier_hz / frame_rate_hz) + 1
    lines = [Line(nominal_hz, harmonic, m) for m in range(-reach, reach + 1)]
    inside = [x for x in lines if 0.0 < x.line_hz(frame_rate_hz) <= 2.0 * carrier_hz]
    return tuple(sorted(inside, key=lambda x: (abs(x.m), x.m)))


def templates(
    lines: tuple[Line, ...], frame_rate_hz: float, rows: int, search_hz: float
) -> NDArray[np.complex128]:
    """Conjugated phase ramps down the rows, shape (rows, lines).

    If 0 Hz is within ``search_hz`` of a line's alias, brightness drift of the whole picture looks
    like flicker; such a ramp is made orthogonal to what all rows have in common.

    Parameters
    ----------
    lines : tuple of Line
    frame_rate_hz : float
    rows : int
    search_hz : float
        Half-width of the search band around the alias.
    """
    turns = np.array([line.turns(frame_rate_hz) for line in lines])
    place = (np.arange(rows) + 0.5) / rows
    ramps = np.exp(-2j * np.pi * place[:, None] * turns) / rows
    for i, line in enumerate(lines):
        if rows > 1 and abs(line.alias_hz(frame_rate_hz)) <= search_hz:
            ramps[:, i] -= ramps[:, i].mean()
    return np.asarray(ramps, np.complex128)


def project(block: RowBlock, ramps: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Project a block's rows onto ramps: slow-time values, shape (frames, lines).

    Strips are averaged; rows without steady pixels count as their strip's background.

    Parameters
    ----------
    block : RowBlock
    ramps : ndarray of complex, shape (rows, lines)
        As of :func:`templates`.
    """
    profile = block.profiles()
    # A real matrix times real and imaginary parts: half the work of a complex product.
    return np.asarray(profile @ ramps.view(np.float64)).view(np.complex128)


Float = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Turns kept beyond those of the fastest ramp, for its modulation by texture.
SPARE_TURNS = 2
TURNS_STEP = 0.05


class ProfileBasis:
    """Cosines and sines of 0 … M turns down the rows, scaled to mean square one.

    Parameters
    ----------
    rows : int
    max_turns : float
        Most turns of any harmonic down one frame.

    Examples
    --------
    >>> basis = ProfileBasis(100, 4.0)
    >>> round(basis.turns_of(basis.ramps(np.array([2.5]))[:, 0]), 3)
    2.5
    """

    def __init__(self, rows: int, max_turns: float) -> None:
        self.rows = rows
        most = min(int(np.ceil(max_turns)) + SPARE_TURNS, (rows - 1) // 2)
        angle = 2.0 * np.pi * np.outer((np.arange(rows) + 0.5) / rows, np.arange(1, most + 1))
        waves = np.sqrt(2.0) * np.hstack([np.cos(angle), np.sin(angle)])
        self._waves = np.hstack([np.ones((rows, 1)), waves])
        count = int(np.ceil(max_turns / TURNS_STEP))
        self._turns: Float = np.asarray(np.arange(-count, count + 1) * TURNS_STEP, np.float64)
        self._grid = self.ramps(self._turns)
        self._grid_power = np.sum(np.abs(self._grid) ** 2, axis=0)

    @property
    def columns(self) -> int:
        """Number of coefficients per frame."""
        return int(self._waves.shape[1])

    def reduce(self, block: RowBlock) -> Float:
        """Coefficients of every frame of a block, shape (frames, columns); strips are averaged.

        Frame by frame, so that the division into blocks doesn't change a bit of the result.
        """
        profile = block.profiles()
        return np.asarray((profile[:, None, :] @ self._waves)[:, 0, :] / self.rows)

    def ramps(self, turns: Float) -> Complex:
        """Coefficients of ramps ``exp(j·2π·turns·x)`` down the frame, shape (columns, ramps)."""
        place = (np.arange(self.rows) + 0.5) / self.rows
        angle = 2.0 * np.pi * np.outer(place, turns)
        # Real products: a complex one would first convert all the waves to complex.
        return np.asarray(
            (self._waves.T @ np.cos(angle) + 1j * (self._waves.T @ np.sin(angle))) / self.rows
        )

    def lit(self, texture: Float, turns: Float) -> tuple[Complex, Complex]:
        """Coefficients of ramps times a texture, and their derivatives by the turns.

        Parameters
        ----------
        texture : ndarray, shape (columns,)
            Coefficients of the texture.
        turns : ndarray, shape (ramps,)

        Returns
        -------
        columns, derivatives : ndarray of complex, shape (ramps, columns)
        """
        place = (np.arange(self.rows) + 0.5) / self.rows
        scene = self._waves @ texture / self.rows
        angle = 2.0 * np.pi * np.outer(turns, place)
        cosine, sine = np.cos(angle) * scene, np.sin(angle) * scene
        later = 2.0 * np.pi * place
        parts = np.concatenate([cosine, sine, -later * sine, later * cosine]) @ self._waves
        real, imag, real_by, imag_by = np.split(parts, 4)
        return real + 1j * imag, real_by + 1j * imag_by

    def turns_of(self, template: Complex) -> float:
        """Turns of the ramp that best matches a template, shape (columns,)."""
        power = np.abs(template.conj() @ self._grid) ** 2 / self._grid_power
        peak = min(max(int(power.argmax()), 1), power.size - 2)
        a, b, c = power[peak - 1 : peak + 2].tolist()
        bend = a - 2.0 * b + c
        beyond = 0.5 * (a - c) / bend if bend < 0.0 else 0.0
        return float(self._turns[peak]) + TURNS_STEP * min(max(beyond, -1.0), 1.0)
