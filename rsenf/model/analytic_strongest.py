"""The two strongest lines and the ratio of their amplitudes, Eq. 22 (``Eq_arg_max``).

The paper calls the ratio one of powers; its numbers are ratios of amplitudes, and so is this.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rsenf.errors import UsageError
from rsenf.model.analytic import PHASES_RAD, SpectralLine

PRINTED_TIE = 1.05  # a smaller ratio is 1.0 in the paper's tables
_EQUAL = 1 + 1e-6
_NOTHING = 1e-9  # of the strongest line: what rounding leaves


@dataclass(frozen=True)
class Strongest:
    """The strongest lines ``H_1``, the next strongest ``H_2``, and the ratio between them.

    Lines of equal amplitude share a place, highest frequency first. Those that share the first
    place are both ``H_1`` and ``H_2``, as in the paper. Where the light makes one line only there
    is no second: ``second`` is empty and ``amplitude_ratio`` None.
    """

    first: tuple[SpectralLine, ...]
    second: tuple[SpectralLine, ...]
    amplitude_ratio: float | None
    ratio_range: tuple[float, float] | None  # over the light's phase; None where it plays no part


def strongest(found: Iterable[SpectralLine], tie_ratio: float = _EQUAL) -> Strongest:
    """Pick the two strongest of some lines, by their root mean square over the light's phase.

    Parameters
    ----------
    found : iterable of SpectralLine
        From :func:`rsenf.model.analytic.lines`.
    tie_ratio : float, optional
        Amplitudes whose ratio is less are equal.

    Raises
    ------
    UsageError
        When there is no line.
    """
    ordered = sorted(found, key=lambda line: -line.amplitude)
    if not ordered:
        raise UsageError("there is no line to pick from", "raise the highest frequency")
    first = _sharing(ordered, tie_ratio)
    if len(ordered) < 2 or ordered[1].amplitude < _NOTHING * ordered[0].amplitude:
        return Strongest(first, (), None, None)
    one, two = ordered[:2]
    second = first if len(first) > 1 else _sharing(ordered[1:], tie_ratio)
    return Strongest(first, second, one.amplitude / two.amplitude, _ratio_range(one, two))


def _sharing(ordered: Sequence[SpectralLine], tie_ratio: float) -> tuple[SpectralLine, ...]:
    """Lines that share the place of the first, highest frequency first."""
    least = ordered[0].amplitude / tie_ratio
    alike = (line for line in ordered if line.amplitude > least)
    return tuple(sorted(alike, key=lambda line: -line.freq_hz))


def _ratio_range(one: SpectralLine, two: SpectralLine) -> tuple[float, float] | None:
    if len(one.parts) == len(two.parts) == 1:
        return None
    with np.errstate(divide="ignore"):
        ratio = one.at_phase(PHASES_RAD) / two.at_phase(PHASES_RAD)
    return float(ratio.min()), float(ratio.max())
