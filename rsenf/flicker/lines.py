"""Lines of a flicker harmonic in the spectrum of the concatenated rows, and projection onto them.

Concatenating the rows of all frames without the time between frames (the paper's row-luminance
series, at ``F_r·L`` samples/s) replaces the line at ``k·f_0`` by lines at ``k·f_0 + m·F_r`` (paper,
Eq. 21, ``Shifted_ENF``). The Fourier sum of that series at ``f_y`` splits into frames: within a
frame it projects the row profile onto a phase ramp of ``f_y/F_r`` turns; from frame to frame every
line of the harmonic advances by the same phase, that of ``k·f_0`` itself. So one small matrix
product per frame gives the slow-time series (one value a frame) of all lines, without
concatenation, interpolation or a long FFT.
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
        """Frequency in the spectrum of the concatenated rows, ``f_y = k·f_0 + m·F_r``."""
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
