"""Edits of simulated clips: how many are found, put where they are, and seen where none is.

Not a test by itself: ``python -m tests.match.edits 200 5000`` edits 200 clips from seed 5000 on,
and leaves as many whole, of which every third isn't in the reference. Nobody claims a start. Seeds
below 1000 are for development.
"""

from __future__ import annotations

import sys
from collections import Counter

import numpy as np

from tests.match.edited_clips import Piece, edited_clip, measured_start
from tests.match.mistakes import Draw, Trial

KINDS = ("cut", "cut twice", "repeated", "inserted")
LEAST_S = 30.0  # of each piece that is left
SIZES_S = (3.0, 120.0)
NEAR_S, SIZE_S = 3.0, 0.5  # of an edit's true place and size, or three times its stated errors


def drawn(seed: int) -> Draw:
    draw = Draw(seed)
    draw.seconds = int(np.exp(draw.rng.uniform(np.log(90), np.log(400))))
    draw.start_s = measured_start(draw.day, draw.seconds + 4000, draw.rng)
    return draw


def edited(seed: int) -> tuple[str, Trial, list[float], list[float]]:
    """A clip with edits: their kind, where in it they are, and how many seconds each takes out."""
    draw, kind = drawn(seed), KINDS[seed % len(KINDS)]
    count = 2 if kind == "cut twice" else 1
    draw.seconds = max(draw.seconds, int((count + 1.5) * LEAST_S))
    while True:
        at_s = np.sort(np.round(draw.rng.uniform(0, draw.seconds, count), 1))
        lengths = np.diff([0.0, *at_s, draw.seconds])
        if lengths.min() >= LEAST_S:
            break
    size_s = np.round(np.exp(draw.rng.uniform(*np.log(SIZES_S), count)), 1)
    if kind == "repeated":
        size_s = -np.minimum(size_s, at_s)
    inserted = kind == "inserted"
    pieces, begin_s, clip_s, lags_s = [], draw.start_s, 0.0, []
    for length, size in zip(lengths, [*size_s, 0.0], strict=True):
        pieces.append(Piece(draw.day, begin_s, float(length)))
        lags_s.append(begin_s - clip_s)
        clip_s += length + (size if inserted else 0.0)
        begin_s += length + (0.0 if inserted else size)
    if inserted:
        other_s = measured_start(draw.other, float(size_s[0]), draw.rng)
        pieces.insert(1, Piece(draw.other, other_s, float(size_s[0])))
        size_s = -size_s
    track = edited_clip(pieces, seed, draw.quality)
    trial = Trial(track, [draw.reference()], tuple(lags_s))
    return kind, trial, at_s.tolist(), size_s.tolist()


def whole(seed: int) -> Trial:
    draw = drawn(seed)
    if seed % 3:
        return Trial(draw.clip(), [draw.reference()], (draw.start_s,))
    draw.start_s = measured_start(draw.other, draw.seconds, draw.rng)
    return Trial(draw.clip(stretch=draw.other), [draw.reference()])


def main(count: int, first_seed: int) -> None:
    totals: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
    for seed in range(first_seed, first_seed + count):
        kind, trial, at_s, size_s = edited(seed)
        result, told = trial.result(), totals[kind]
        told["clips"] += 1
        told["edits"] += len(at_s)
        told["told"] += bool(result.edits)
        told["match at a wrong time"] += trial.wrong(result) == "match at a wrong time"
        told["match without a word"] += result.decision == "match" and not result.edits
        told["no match"] += result.decision == "no_match"
        sized = [edit for edit in result.edits if np.isfinite(edit.size_std_s)]
        for edit in sized:
            away_s = np.abs(np.array(at_s) - edit.at_s)
            near = int(away_s.argmin())
            placed = away_s[near] <= max(3 * edit.at_std_s, NEAR_S)
            off_s = abs(edit.size_s - abs(size_s[near]))
            right = placed and off_s <= max(3 * edit.size_std_s, SIZE_S)
            told["placed and sized" if right else "wrong"] += 1
            if not right:
                print(f"  seed {seed}: {kind} at {at_s} by {size_s}: {edit}", file=sys.stderr)
    for kind, told in totals.items():
        print(f"{kind:10s} {', '.join(f'{name} {n}' for name, n in told.items())}")
    false = 0
    for seed in range(first_seed, first_seed + count):
        result = whole(seed).result()
        false += bool(result.edits)
        for edit in result.edits:
            print(f"  seed {seed}: whole: {edit.text}", file=sys.stderr)
    print(f"whole      clips {count}, false edits {false}")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
