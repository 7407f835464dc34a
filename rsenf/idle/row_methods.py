"""Earlier methods, from every row's own tone: the paper's line ratio, and vertical phase analysis.

Model: row ``l`` holds a tone ``A_l·exp(j·2π·q·l/L)`` at the alias, ``q = (f_0/F_r)(1 − ρ)``. With
the rows of all frames concatenated the line at ``f_0 − m·F_r`` (paper, Eq. 21) has the amplitude
``|sinc(c − m)|``, ``c = f_0·ρ/F_r``, the limit of the paper's Eq. 7 for many rows.

Statistic: *line ratio*: the strongest two lines are the neighbours of ``c``, and the ratio of their
amplitudes is ``(1 − x)/x`` with ``x`` the distance of ``c`` from the stronger one; folded lines
belong to the model as any other. ``line_ratio_bins`` looks the ratio up in the paper's table in
steps of 5 %. *Vertical phase*: the slope of the rows' unwrapped phases by weighted least squares,
weights ``|A_l|²``; the phase advances by ``2π·f_0·T_ro/L`` from row to row (paper, Eq. 23). With
``N_c`` turns down the rows the idle ratio is ``1 − N_c·F_r/f_0`` (Eq. 24 inverts the fraction).

Approximate: the line ratio takes the texture ``A_l`` as constant down the rows; its error is a
third of what the third line implies otherwise, and the share of the tones off the ramp. Each row is
fitted by itself, so a weak one unwraps wrongly. At an alias of 0 Hz flicker and texture of a row
are the same, and both refuse.

References
----------
- Vatansever, S., Dirik, A. E. and Memon, N. (2019), Analysis of rolling shutter effect on ENF based
  video forensics, IEEE TIFS 14.
- Hajj-Ahmad, A., Berkovich, A. and Wu, M. (2016), Exploiting power signatures for camera forensics,
  IEEE Signal Processing Letters 23, 713.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rsenf.flicker.lines import Line, templates
from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.moments import coherence, row_tones
from rsenf.idle.ramp import bends, freedom, left_out
from rsenf.idle.refusals import MIN_COHERENCE, NO_RAMP, STILL, WEAK, hardly_turned, is_weak, refused

Float = NDArray[np.float64]

BIN = 0.05  # idle ratio between the rows of the paper's tables
# Nearer than this to one line the second is too weak to determine the side.
ON_A_LINE = 0.01

# Texture changes the difference of the two neighbours' places by three times its effect on ``c``.
DOUBT = 1.0 / 3.0

MIRRORED = refused(
    "the frame rate divides the flicker's frequency: lines fall on their own mirror images and on "
    "the texture, and their ratio depends on the light's phase"
)
NO_MATCH = refused("no match: the strongest lines aren't those of one ramp, as the model has them")


@dataclass(frozen=True)
class TwoLines:
    """The strongest line ``m``, the side of the second strongest, and their amplitude ratio.

    ``third_ratio`` is that of the strongest line to its other neighbour, ``aligned`` the share of
    the rows' tones that adds up along the ramp that the lines imply.
    """

    m: int
    side: int
    ratio: float
    third_ratio: float
    aligned: float = 1.0

    def place(self) -> float:
        """``c``, from the strongest two (paper, Eq. 7)."""
        return self.m + self.side / (1.0 + self.ratio)

    def error(self) -> float:
        """Standard error of ``c``, from the misfit of the model.

        A share of the difference from what the third line implies, which is ``(1 + x)/x`` times
        weaker than the first; and the share of the tones that is off the ramp.
        """
        third = 1.0 / (1.0 + self.ratio) - 1.0 / max(self.third_ratio - 1.0, 1.0)
        return math.hypot(DOUBT * third, 1.0 - self.aligned)


def continuous(seen: EstimatorState) -> Finding:
    """Estimate from the two strongest lines, also between the rows of the tables."""
    found = _two_lines(seen)
    if isinstance(found, Finding):
        return found
    return _claim(seen, found.place(), found.error())


def binned(seen: EstimatorState) -> Finding:
    """Estimate by the nearest row of the paper's table with these lines (paper, Eq. 22)."""
    found = _two_lines(seen)
    if isinstance(found, Finding):
        return found
    table = [
        (abs(math.log(ratio / found.ratio)), c)
        for c, ratio in _table(seen.most_turns, found.m, found.side)
    ]
    if not table:
        return NO_MATCH
    error = math.hypot(found.error(), BIN / math.sqrt(12.0) * seen.most_turns)
    return _claim(seen, min(table)[1], error)


def _two_lines(seen: EstimatorState) -> TwoLines | Finding:
    if seen.stands_still:
        return MIRRORED
    if hardly_turned(seen):
        return STILL
    tone, level = row_tones(seen.moments)
    if is_weak(seen, 2.0 * float(np.abs(tone).mean() / level.mean())):
        return WEAK
    number = np.arange(-1, math.ceil(2.0 * seen.most_turns) + 2)
    lines = tuple(Line(seen.f0_hz / 2.0, 1, -int(m)) for m in number)
    # Ramps keep their mean (search band below 0): the rows' tones hold no texture.
    size = np.abs(tone @ templates(lines, seen.frame_rate_hz, tone.size, -1.0))
    first = int(np.argmax(size[1:-1])) + 1
    side = 1 if size[first + 1] > size[first - 1] else -1
    others = np.delete(size, [first, first + side])
    if others.max() > size[first + side]:
        return NO_MATCH
    floor = np.finfo(float).tiny
    found = TwoLines(
        int(number[first]),
        side,
        float(size[first] / max(size[first + side], floor)),
        float(size[first] / max(size[first - side], floor)),
    )
    aligned = coherence(tone, level, seen.most_turns - found.place())
    return replace(found, aligned=aligned) if aligned >= MIN_COHERENCE else NO_MATCH


def _table(most_turns: float, m: int, side: int) -> list[tuple[float, float]]:
    """Rows of the paper's table with these two lines: ``c`` and the ratio, for both directions."""
    out = []
    for idle in np.arange(0.0, 1.0, BIN):
        for c in (idle * most_turns, (2.0 - idle) * most_turns):
            x = (c - m) * side
            if abs(x) < ON_A_LINE:
                out.append((c, 1.0 / ON_A_LINE))
            elif 0.0 < x <= 0.5:
                out.append((c, (1.0 - x) / x))
    return out


def _claim(seen: EstimatorState, c: float, error: float) -> Finding:
    return Finding.of_turns(seen.most_turns - c, error**2, seen.f0_hz)


AT_ZERO = refused(
    "the flicker's alias is at 0 Hz, where a row's flicker can't be told from texture"
)


def vertical_phase(seen: EstimatorState) -> Finding:
    """Estimate from the slope of the rows' phases (paper, Eqs. 23 and 24)."""
    if seen.stands_still:
        return AT_ZERO
    if hardly_turned(seen):
        return STILL
    tone, level = row_tones(seen.moments)
    if is_weak(seen, 2.0 * float(np.abs(tone).mean() / level.mean())):
        return WEAK
    phase, weight = np.unwrap(np.angle(tone)), np.abs(tone) ** 2
    slope = _slopes(phase, weight[None, :])[0]
    if coherence(tone, level, float(slope) * phase.size / (2.0 * np.pi)) < MIN_COHERENCE:
        return NO_RAMP
    without = _slopes(phase, weight * left_out(phase.size))
    scale = phase.size / (2.0 * np.pi)
    jackknife_var = (len(without) - 1) * float(np.var(without))
    shapes = weight * bends(weight)
    bent = (shapes @ phase)[1:] / (shapes[0] @ bends(weight)[0])
    variance = max(jackknife_var * scale**2, float(np.mean(bent**2)) / (2.0 * np.pi) ** 2)
    return Finding.of_turns(float(slope) * scale, variance, seen.f0_hz, freedom(phase.size))


def _slopes(phase: Float, weight: Float) -> Float:
    """Weighted slopes of the phase by row number: (tries,) for weights (tries, rows)."""
    row = np.arange(phase.size)
    total = weight.sum(axis=1)
    place = row - (weight @ row / total)[:, None]
    return np.asarray(np.sum(weight * place * phase, axis=1) / np.sum(weight * place**2, axis=1))
