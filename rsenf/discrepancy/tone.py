"""Finds a tone of constant frequency in the residual, and the frequencies it may be an alias of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.discrepancy.fit import Fit
from rsenf.discrepancy.residual_breakdown import ResidualShare
from rsenf.discrepancy.residue import residue_of

HIGHEST_HZ = 3000.0  # of lamp drivers' flicker that row means can show
HARMONICS = 4  # harmonics of the flicker whose lines are excluded
NEAR_HZ = 0.15  # tolerance of a line's frequency, beyond the grid's wander
MOST = 0.5  # least share of the residual of a tone and its sidebands about the flicker


@dataclass(frozen=True)
class Tone:
    """A tone of constant frequency, of which the frames show an alias.

    Attributes
    ----------
    alias_hz : float
    likely_hz : tuple of float
        Frequencies of light that agree with the phase ramp down the lines, the likeliest first.
    may_be_hz : tuple of float
        All frequencies with this alias, rising.
    """

    alias_hz: float
    likely_hz: tuple[float, ...]
    may_be_hz: tuple[float, ...]


def tone_of(last: Fit, lines: Sequence[ResidualShare]) -> Tone | None:
    """Find a tone that isn't the flicker's and that, with its sidebands, is most of the residual.

    Parameters
    ----------
    last : Fit
    lines : sequence of ResidualShare
        Spectral lines of its residual.
    """
    rate_hz = float(last.data.frame_rate)
    expected_hz = [(0.0, NEAR_HZ), *flicker_hz(last, range(1, HARMONICS + 1))]
    strange = [line for line in lines if not is_at(line, expected_hz)]
    if not strange:
        return None
    strongest = max(strange, key=lambda line: line.share)
    alias_hz = (strongest.low + strongest.high) / 2.0
    ((first_hz, width_hz),) = flicker_hz(last, range(1, 2))
    sides = [(_folded(first_hz + s * alias_hz, rate_hz), width_hz) for s in (-1, 1)]
    # Includes the skirts of the line itself.
    kin = [(alias_hz, 2.0 * NEAR_HZ), *sides]
    if sum(line.share for line in strange if is_at(line, kin)) < MOST:
        return None
    likely = [
        hz for hz in residue_of(last).tones_hz if abs(_folded(hz, rate_hz) - alias_hz) < NEAR_HZ
    ]
    if likely:
        alias_hz = _folded(likely[0], rate_hz)
    turns = np.arange(-round(HIGHEST_HZ / rate_hz), round(HIGHEST_HZ / rate_hz) + 1)
    may_be = np.unique(np.round(np.abs(alias_hz + turns * rate_hz), 3))
    may_be = may_be[may_be <= HIGHEST_HZ]
    return Tone(round(alias_hz, 3), tuple(round(hz, 3) for hz in likely), tuple(may_be.tolist()))


def flicker_hz(last: Fit, harmonics: range) -> list[tuple[float, float]]:
    """Alias of each harmonic of the flicker, and half the width of its line (Hz)."""
    freq_hz = 2.0 * last.theory.course.grid().freq_hz
    mean_hz, width_hz = float(freq_hz.mean()), float(np.ptp(freq_hz))
    rate_hz = float(last.data.frame_rate)
    return [(_folded(k * mean_hz, rate_hz), NEAR_HZ + k * width_hz) for k in harmonics]


def _folded(freq_hz: float, rate_hz: float) -> float:
    away_hz = freq_hz % rate_hz
    return min(away_hz, rate_hz - away_hz)


def is_at(line: ResidualShare, places: Sequence[tuple[float, float]]) -> bool:
    """Return whether a spectral line is at one of several places (frequency and tolerance, Hz)."""
    middle_hz = (line.low + line.high) / 2.0
    return any(abs(middle_hz - place_hz) < near_hz for place_hz, near_hz in places)
