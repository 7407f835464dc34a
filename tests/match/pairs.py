"""Pairs of recordings: are they said to be made together, and is what is said of it true?

Not a test by itself: ``python -m tests.match.pairs 200 5000`` draws 200 pairs of the same time from
seed 5000 on, and as many of different times, on measured grids. It prints decisions, what came true
of each likelihood ratio, and errors over stated ones.
"""

from __future__ import annotations

import dataclasses
import itertools
import sys
from collections import Counter

import numpy as np

from rsenf.match.against import Against, match_against
from rsenf.match.settings import MatchSettings
from tests.match.edited_clips import Piece, edited_clip, measured_start
from tests.match.mistakes import Draw

LEAST_S = 40.0  # that they have in common
EDGES = (-np.inf, -2.0, -1.0, 0.0, 1.0, 2.0, np.inf)
WRONG_S = 1.0


def compared(seed: int, *, together: bool) -> tuple[Against, float]:
    """Compare a pair; its true offset is NaN where there is none."""
    draw, other = Draw(seed), Draw(seed + 500_000)
    rng = draw.rng
    seconds = [float(np.exp(rng.uniform(np.log(60), np.log(400)))) for _ in range(2)]
    lead_s = float(rng.uniform(-(seconds[0] - LEAST_S), seconds[1] - LEAST_S))
    begin_s = draw.start_s = measured_start(draw.day, sum(seconds) + 500, rng) + 400.0
    if not together:
        away_s = rng.uniform(sum(seconds), 6 * 3600.0) * rng.choice([-1, 1])
        begin_s = (begin_s + away_s) % 80_000.0
    pieces = (
        Piece(draw.day, begin_s + lead_s, seconds[0]),
        Piece(draw.day, draw.start_s, seconds[1]),
    )
    tracks = [
        edited_clip([piece], seed + k, dataclasses.replace(quality))
        for k, (piece, quality) in enumerate(
            zip(pieces, (draw.quality, other.quality), strict=True)
        )
    ]
    found = match_against(tracks[0], tracks[1], MatchSettings())
    return found, lead_s if together else float("nan")


def main(count: int, first_seed: int) -> None:
    told = {True: Counter[str](), False: Counter[str]()}
    by_ratio: list[tuple[float, bool]] = []
    errors = []
    for seed in range(first_seed, first_seed + count):
        for together in (True, False):
            try:
                found, true_s = compared(seed, together=together)
            except ValueError:
                continue  # not measured there
            wrong = found.decision == "match" and not abs(found.offset_s - true_s) < WRONG_S
            told[together][found.decision + (", wrong" if wrong else "")] += 1
            if np.isfinite(found.log10_lr):
                by_ratio.append((found.log10_lr, together))
            if found.decision == "match" and not wrong:
                errors.append((found.offset_s - true_s) / found.offset_std_s)
    for together, counts in told.items():
        print("together" if together else "apart", dict(counts))
    for low, high in itertools.pairwise(EDGES):
        own = [(lr, came) for lr, came in by_ratio if low <= lr < high]
        if own:
            said = np.mean([10**lr / (1 + 10**lr) for lr, _ in own])
            came = np.mean([came for _, came in own])
            print(f"{low:+.0f} … {high:+.0f}: said {said:.1%}, came {came:.1%} of {len(own)}")
    print(f"errors of the offset over stated ones: {np.sqrt(np.mean(np.square(errors))):.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
