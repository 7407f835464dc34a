"""How often the matcher decides, and how often rightly, on measured grids.

Not a test by itself: ``python -m tests.match.decision_rates 50 20`` prints the table for 50 trials
a row and 20 s windows. The thresholds of
:class:`rsenf.match.MatchSettings` and the constants of :mod:`rsenf.match.search` were chosen on
the first half of the 2022 day (with clips of its second half, and of the Wuhan grid, as absent
ones); the table is of other data and other seeds.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.match import MatchSettings
from rsenf.match.correlate import match_ncc
from rsenf.match.series import Grid
from rsenf.reference import Reference, read_reference
from tests.match.match_clips import clip_of, grid_from

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Rates:
    """Counts of decisions."""

    trials: int
    true: int
    false: int
    no_match: int

    def __str__(self) -> str:
        open_ = self.trials - self.true - self.false - self.no_match
        return f"{self.true:4d} true {self.false:3d} false {self.no_match:4d} none {open_:4d} open"


@dataclass(frozen=True, eq=False)
class Trials:
    """Clips of one grid searched for in another, or in itself."""

    reference_hz: np.ndarray
    source_hz: np.ndarray

    def run(self, seconds, count, *, seed, present, window_s=20.0) -> Rates:
        rng = np.random.default_rng(seed)
        grid = grid_from(self.reference_hz)
        counts = Counter()
        for trial in range(count):
            start_s = self._start(seconds, rng)
            ppm = float(rng.standard_t(4) * 30)
            clip = clip_of(
                self.source_hz,
                start_s,
                seconds,
                seed=(seed, trial),
                std_hz=rng.uniform(0.3e-3, 1.5e-3),
                ppm=ppm,
                window_s=window_s,
            )
            found = match_ncc(clip, grid, MatchSettings())
            right = present and abs(found.lag_s - start_s) <= 1
            counts["true" if right else "false"] += found.decision == "match"
            counts["no_match"] += found.decision == "no_match"
        return Rates(count, counts["true"], counts["false"], counts["no_match"])

    def _start(self, seconds, rng):
        """A start whose whole clip, and a little more, was measured."""
        while True:
            start_s = float(rng.uniform(30, self.source_hz.size - seconds - 30))
            part = self.source_hz[int(start_s) - 15 : int(start_s) + seconds + 15]
            if np.isfinite(part).all():
                return start_s


def grid_of_reference(reference: Reference) -> Grid:
    return Grid(
        reference.grid,
        reference.nominal_hz,
        reference.t0_ns,
        reference.step_s,
        reference.freq_hz,
    )


def main(count: int, window_s: float) -> None:
    day = read_reference(DATA / "grid_ce_2022-09-17_1s.csv.gz").freq_hz
    week = read_reference(DATA / "grid_ce_2024-08-13_to_21_gappy_1s.csv.gz").freq_hz
    cases = {
        "present, 12 h of 2022": (day[43_200:], day[43_200:], True),
        "present, 24 h of 2022": (day, day, True),
        "present, gappy week of 2024": (week, week, True),
        "absent, 24 h of 2022 searched for 2024": (day, week, False),
        "absent, gappy week of 2024 searched for 2022": (week, day, False),
    }
    for name, (reference_hz, source_hz, present) in cases.items():
        for seconds in (60, 120, 300, 600):
            rates = Trials(reference_hz, source_hz).run(
                seconds, count, seed=901, present=present, window_s=window_s
            )
            print(f"{name:46s} {seconds:4d} s: {rates}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]))
