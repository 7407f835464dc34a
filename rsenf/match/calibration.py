"""From a search's own likelihood ratio to one that may be believed.

The phase matcher's likelihoods rest on a model of grids, clocks and codecs; what its ratios are
worth is measured on searches of real grids whose answer is known. A straight line between the
logarithms (logistic regression, after Brümmer and du Preez, Computer Speech & Language 20, 2006)
is fitted to them by ``rsenf bench calibration`` and kept in ``calibration.json``, with the limit
that so many searches can vouch for.
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
class Line:
    """Calibrated log10 likelihood ratio: ``slope · raw + intercept``, at most ``limit`` either way.

    ``limit`` is the logarithm of a third of the cases that could have gone wrong: of an error that
    none of ``n`` cases shows no more is known than that it is rarer than ``3/n`` (rule of three).
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
    """A line for each question, and what it was made from.

    ``other``: this time against another in the reference; ``absent``: this time against none in
    it; ``claim``: a claimed time against another.
    """

    other: Line
    absent: Line
    claim: Line
    made: str

    @property
    def lines(self) -> dict[str, Line]:
        """The lines by their questions."""
        return {"other": self.other, "absent": self.absent, "claim": self.claim}


@lru_cache(maxsize=1)
def calibration() -> Calibration:
    """Read the calibration that comes with the package."""
    held = json.loads(files("rsenf.match").joinpath(FILE).read_text(encoding="utf-8"))
    assert held["version"] == VERSION
    lines = {name: Line(**line) for name, line in held["lines"].items()}
    return Calibration(**lines, made=held["made"])
