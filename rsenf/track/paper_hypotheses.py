"""Hypotheses of the paper's time-of-recording verification: every line with every idle ratio."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.flicker.lines import Line

IDLE_RATIOS = tuple(percent / 100.0 for percent in range(0, 100, 5))
# Frame rates (at 50 Hz) for which the paper lists its lines, without folded ones.
PUBLISHED_RATES_HZ = (25.0, 30000 / 1001, 30.0)
SAME_RATE_HZ = 0.01


@dataclass(frozen=True)
class Hypothesis:
    """A spectral line of the rows, concatenated under an assumed idle ratio.

    Parameters
    ----------
    line : Line
    idle_ratio : float
    """

    line: Line
    idle_ratio: float

    def period_rows(self, rows: int) -> int:
        """Rows that fit into a frame period, ``M = L/(1 − ρ)``, rounded to a whole row."""
        return round(rows / (1.0 - self.idle_ratio))


def hypotheses(nominal_hz: float, frame_rate_hz: float, search_hz: float) -> tuple[Hypothesis, ...]:
    """List every line with every idle ratio of 0, 5, … 95 %, line by line.

    Parameters
    ----------
    nominal_hz : float
        Nominal grid frequency.
    frame_rate_hz : float
    search_hz : float
        Half-width of the search band around a line.
    """
    lines = paper_lines(nominal_hz, frame_rate_hz, search_hz)
    return tuple(Hypothesis(line, idle) for line in lines for idle in IDLE_RATIOS)


def paper_lines(nominal_hz: float, frame_rate_hz: float, search_hz: float) -> tuple[Line, ...]:
    """Lines of the paper's Section V, in the order of their frequency.

    They are ``|f_0 + m·F_r| ≤ 2·f_0`` and the second harmonic ``2·f_0``. At 25, 29.97 and 30
    frames/s of a 50 Hz grid the paper lists 25, 50 … 200 Hz and 10, 40 … 190, 200 Hz, without lines
    folded at 0 Hz, which its bound on ``m`` (Eq. 20) excludes; so they are left out at these rates.
    Of lines within one search band only the first is kept, as all would find the same peak; and
    none within a search band of 0 Hz, where it would overlap its own mirror image.

    Parameters
    ----------
    nominal_hz, frame_rate_hz : float
    search_hz : float
        Half-width of the search band around a line.

    Examples
    --------
    >>> [round(line.line_hz(30.0)) for line in paper_lines(50.0, 30.0, 0.5)]
    [10, 40, 70, 100, 130, 160, 190, 200]
    """
    f0_hz = 2.0 * nominal_hz
    reach = int(3.0 * f0_hz / frame_rate_hz) + 1
    comb = [Line(nominal_hz, 1, m) for m in range(-reach, reach + 1)]
    comb.sort(key=lambda line: (line.line_hz(frame_rate_hz) < 0.0, abs(line.m), line.m))
    found: list[Line] = []
    for line in (Line(nominal_hz, 2, 0), *comb):
        place_hz = line.line_hz(frame_rate_hz)
        folded = place_hz < 0.0 and _is_published(nominal_hz, frame_rate_hz)
        outside = not search_hz < abs(place_hz) <= 2.0 * f0_hz
        taken = (abs(x.line_hz(frame_rate_hz)) for x in found)
        if not (folded or outside or any(abs(abs(place_hz) - t) < search_hz for t in taken)):
            found.append(line)
    return tuple(sorted(found, key=lambda line: abs(line.line_hz(frame_rate_hz))))


def _is_published(nominal_hz: float, frame_rate_hz: float) -> bool:
    near = any(abs(frame_rate_hz - rate) < SAME_RATE_HZ for rate in PUBLISHED_RATES_HZ)
    return nominal_hz == 50.0 and near
