"""Where a flicker harmonic shows in the spectrum of the concatenated rows, and how to look there.

Concatenating the rows of all frames as if no time passed between frames (the paper's row-luminance
series, at ``F_r·L`` samples a second) replaces the line at ``k·f_0`` by lines at ``k·f_0 + m·F_r``
(paper Eq. 20, ``Shifted_ENF``). Summing that series against ``exp(−j·2π·f_y·i/(F_r·L))`` can be
done frame by frame: within a frame it is a projection of the row profile onto a phase ramp of
``f_y/F_r`` turns, and from frame to frame every line of the harmonic advances by the same phase,
that of ``k·f_0`` itself. So one small matrix product per frame gives the slow-time series of all
lines, and no concatenation, interpolation or long FFT is needed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rsenf.messages import RowBlock

# Nearer to half the frame rate than this a tone and its mirror image look alike in the frames.
MIRRORED_HZ = 1.0
# Deviation of the illumination's frequency that is large for a grid, as a standard deviation; and
# the logarithm of the odds at which the more usual of two deviations counts as known.
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
        Line number of the paper's Eq. 20; negative numbers are its second case.
    """

    nominal_hz: float
    harmonic: int
    m: int

    @property
    def carrier_hz(self) -> float:
        """Return the harmonic's nominal frequency, ``k·f_0``."""
        return 2.0 * self.nominal_hz * self.harmonic

    def line_hz(self, frame_rate_hz: float) -> float:
        """Position in the spectrum of the concatenated rows, ``f_y = k·f_0 + m·F_r``."""
        return self.carrier_hz + self.m * frame_rate_hz

    def alias_hz(self, frame_rate_hz: float) -> float:
        """Return the frequency at which it shows from frame to frame, within ± half the rate."""
        return alias_hz(self.carrier_hz, frame_rate_hz)

    def turns(self, frame_rate_hz: float) -> float:
        """Turns of phase down the rows of one frame, ``f_y / F_r``."""
        return self.line_hz(frame_rate_hz) / frame_rate_hz


def mirror_hz(nominal_hz: float, frame_rate_hz: float) -> float:
    """Return the frequency about which light's mirror image lies, near half the frame rate.

    There both senses of rotation look the same from frame to frame; NaN elsewhere.
    """
    double_hz = 4.0 * nominal_hz
    apart_hz = alias_hz(double_hz, frame_rate_hz)
    return (double_hz - apart_hz) / 2.0 if abs(apart_hz) < MIRRORED_HZ else float("nan")


def usual_log_odds(off_hz: float, other_off_hz: float) -> float:
    """Logarithm of the odds of two deviations of the illumination from its nominal frequency."""
    return (other_off_hz**2 - off_hz**2) / (2.0 * USUAL_HZ**2)


def alias_hz(carrier_hz: float, frame_rate_hz: float) -> float:
    """Return where a frequency shows from frame to frame, within ± half the rate."""
    return (carrier_hz + frame_rate_hz / 2) % frame_rate_hz - frame_rate_hz / 2


def candidate_lines(
    nominal_hz: float, harmonic: int, frame_rate_hz: float, rows: int
) -> tuple[Line, ...]:
    """Lines the paper searches: ``0 < k·f_0 + m·F_r ≤ 2·k·f_0``, the nearest to ``k·f_0`` first.

    A series with a single mean per frame has no ramp down the rows: only ``m = 0`` is left, the
    alias that Garg et al. (2011) work on.
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

    Where 0 Hz lies within ``search_hz`` of a line's alias, drifts of the whole picture's brightness
    look like flicker; such a ramp is made blind to what all rows have in common.
    """
    turns = np.array([line.turns(frame_rate_hz) for line in lines])
    place = (np.arange(rows) + 0.5) / rows
    ramps = np.exp(-2j * np.pi * place[:, None] * turns) / rows
    for i, line in enumerate(lines):
        if rows > 1 and abs(line.alias_hz(frame_rate_hz)) <= search_hz:
            ramps[:, i] -= ramps[:, i].mean()
    return np.asarray(ramps, np.complex128)


def project(block: RowBlock, ramps: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Slow-time value of every frame for every line, shape (frames, lines).

    Strips are averaged; rows in which nothing was steady count as their strip's background.
    """
    profile = block.profiles()
    # A real matrix times the two parts of a complex one: half the work.
    return np.asarray(profile @ ramps.view(np.float64)).view(np.complex128)
