"""What the paper's time-of-recording procedure tries: every line under every idle ratio."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.flicker.lines import Line

IDLE_RATIOS = tuple(percent / 100.0 for percent in range(0, 100, 5))
# Where the paper names its lines, those without a folded one are all; frames/s at 50 Hz.
PUBLISHED_RATES_HZ = (25.0, 30000 / 1001, 30.0)
SAME_RATE_HZ = 0.01


@dataclass(frozen=True)
class Hypothesis:
    """One line to look at, in the rows concatenated as if the idle ratio were this one.

    Parameters
    ----------
    line : Line
    idle_ratio : float
    """

    line: Line
    idle_ratio: float

    def period_rows(self, rows: int) -> int:
        """Rows that fit into a frame period, ``M = L/(1 − ρ)`` to the nearest whole row."""
        return round(rows / (1.0 - self.idle_ratio))


def hypotheses(nominal_hz: float, frame_rate_hz: float, search_hz: float) -> tuple[Hypothesis, ...]:
    """Every line under every idle ratio of 0, 5, … 95 %; line by line, as the lines stand.

    Parameters
    ----------
    nominal_hz : float
        Nominal grid frequency.
    frame_rate_hz : float
    search_hz : float
        Half-width of the band searched about a line.
    """
    lines = paper_lines(nominal_hz, frame_rate_hz, search_hz)
    return tuple(Hypothesis(line, idle) for line in lines for idle in IDLE_RATIOS)


def paper_lines(nominal_hz: float, frame_rate_hz: float, search_hz: float) -> tuple[Line, ...]:
    """Lines of the paper's Section V, in the order of their place.

    They are ``|f_0 + m·F_r| ≤ 2·f_0`` and ``2·f_0`` itself, the second harmonic. At 25, 29.97 and
    30 frames/s of a 50 Hz grid the paper lists 25, 50 … 200 Hz and 10, 40 … 190, 200 Hz: none of
    the lines that fold at 0 Hz, which its bound on ``m`` (Eq. 20) leaves out, so they are left out
    there. Of lines within one band only the first stands, as both would find the same peak; and
    none stands within a band of 0 Hz, where it would meet its own mirror image.
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
