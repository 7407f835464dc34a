"""Calibrates a search's likelihood ratio on searches with known answers.

The phase matcher's likelihoods rest on a model of grids, clocks and codecs, so their ratios may be
too large or too small. A line between raw and calibrated log ratios (logistic regression, Brümmer
and du Preez, Application-independent evaluation of speaker detection, Computer Speech & Language
20, 2006) is fitted to searches of real grids by ``rsenf bench calibration`` and kept in
``calibration.json``, with the limit that the number of these searches supports.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files

VERSION = 1
FILE = "calibration.json"


@dataclass(frozen=True)
class CalibrationLine:
    """Calibrated log10 likelihood ratio: ``slope · raw + intercept``, clipped to ``±limit``.

    ``limit`` is log10 of a third of the number of cases: if none of ``n`` cases shows an error, its
    rate is below ``3/n`` with 95 % confidence (rule of three).
    """

    slope: float
    intercept: float
    limit: float

    def __call__(self, raw: float) -> float:
        """Calibrate a raw log10 likelihood ratio; NaN stays NaN."""
        if math.isnan(raw):
            return raw
        return min(max(self.slope * raw + self.intercept, -self.limit), self.limit)


@dataclass(frozen=True)
class Calibration:
    """One line for each question, and the data that they were fitted to (``made``).

    ``other``: this time against another in the reference; ``absent``: this time against a time
    outside the reference; ``claim``: a claimed time against any other time.
    """

    other: CalibrationLine
    absent: CalibrationLine
    claim: CalibrationLine
    made: str

    @property
    def lines(self) -> dict[str, CalibrationLine]:
        """The lines by name."""
        return {"other": self.other, "absent": self.absent, "claim": self.claim}


@lru_cache(maxsize=1)
def calibration() -> Calibration:
    """Read the calibration that comes with the package."""
    held = json.loads(files("rsenf.match").joinpath(FILE).read_text(encoding="utf-8"))
    assert held["version"] == VERSION
    lines = {name: CalibrationLine(**line) for name, line in held["lines"].items()}
    return Calibration(**lines, made=held["made"])
