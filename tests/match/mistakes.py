"""What is said of the usual mistakes, and how often.

Not a test by itself: ``python -m tests.match.mistakes 20 5000`` prints, for 20 trials of each
mistake from seed 5000 on, which verdict came and which warning. Below seed 1000 the grids are those
that calibrated the matcher, above it those that it has never seen.
"""

from __future__ import annotations

import dataclasses
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.bench.scenes import FIT, TEST, stretches
from rsenf.match import Match
from rsenf.match.series import Grid, Track
from rsenf.messages import MatchResult
from rsenf.reference import read_reference
from tests.match.edited_clips import (
    Piece,
    Quality,
    edited_clip,
    measured_start,
    reference_of,
)
from tests.match.match_clips import estimates_from

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SEEN = 1000  # seeds below it are for development
T0_NS = 1_663_372_800_000_000_000
HOUR_NS = 3_600 * 10**9
DAY_S = 86_400
HINTS = {
    "cut": "cut and rejoined?",
    "loop": "looped?",
    "order": "rearranged?",
    "put in": "that the reference lacks",
    "ends": "don't fit what is beside them",
    "jump": "the light's phase jumps",
    "zone": "a time zone or daylight saving?",
    "step": "is the step wrong?",
    "speed": "wrong frame times?",
    "outside": "outside of the reference",
}


@dataclass(frozen=True, eq=False)
class Trial:
    """One comparison; ``true_s`` are lags that a match may name, none for a clip that isn't there.

    ``honest`` says that nothing is wrong with it, so that any hint is a false alarm.
    """

    track: Track
    grids: Sequence[Grid]
    true_s: tuple[float, ...] = ()
    claimed_ns: int = 0
    claim_is_true: bool = False
    honest: bool = False

    def result(self) -> MatchResult:
        stage = Match(grids=self.grids, claimed_utc_ns=self.claimed_ns)
        for estimate in estimates_from(self.track):
            stage.update(estimate)
        (result,) = stage.flush()
        return result

    def wrong(self, result: MatchResult) -> str:
        """What was said with confidence and isn't so; empty for nothing."""
        near = any(abs(result.lag_s - lag_s) <= 1.0 for lag_s in self.true_s)
        if result.decision == "match" and not near:
            return "match at a wrong time"
        if result.decision == "no_match" and self.honest and self.true_s:
            return "no match, but it is there"
        if result.claim == "supported" and not self.claim_is_true:
            return "wrong claim supported"
        if result.claim == "refuted" and self.claim_is_true:
            return "true claim refuted"
        return ""


class Draw:
    """Clips and references of one seed."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.rng = np.random.default_rng(seed)
        part = FIT if seed < SEEN else TEST
        self.day = _day(stretches(DATA, part)[0])
        self.other = _day(stretches(DATA, TEST if part == FIT else FIT)[0])
        self.seconds = int(np.exp(self.rng.uniform(np.log(100), np.log(300))))
        self.quality = Quality(
            noise_rad=float(np.exp(self.rng.uniform(np.log(0.005), np.log(0.1)))),
            claimed_ratio=float(self.rng.uniform(1.0, 2.0)),
            clock_ppm=float(self.rng.standard_t(4) * 25.0),
        )
        self.start_s = measured_start(self.day, self.seconds + 4000, self.rng)

    def reference(self, *, t0_ns: int = T0_NS) -> Grid:
        return reference_of(self.day, self.seed, t0_ns=t0_ns)

    def clip(self, *pieces: tuple[float, float], stretch: Grid | None = None) -> Track:
        """Pieces of the day: seconds after the clip's start, and length; all of it without any."""
        own = pieces or ((0.0, self.seconds),)
        stretch = stretch or self.day
        return edited_clip(
            [Piece(stretch, self.start_s + begin, length) for begin, length in own],
            self.seed,
            self.quality,
        )

    def at(self, hours: float = 0.0) -> int:
        """When the clip began, or some hours later."""
        return T0_NS + round(self.start_s * 1e9) + round(hours * HOUR_NS)

    def zone(self) -> float:
        return float(self.rng.choice([-9, -8, -5, -2, -1, 1, 2, 5.5, 8, 9]))

    def split(self) -> tuple[float, float]:
        """Two parts of the clip that are long enough to be found."""
        first = round(float(self.rng.uniform(45, self.seconds - 45)), 1)
        return first, self.seconds - first


def _day(stretch: Grid) -> Grid:
    """The day of it with the fewest gaps."""
    there = np.cumsum(np.isfinite(stretch.freq_hz))
    first = int(np.argmax(there[DAY_S - 1 :] - np.append(0, there[:-DAY_S])))
    return dataclasses.replace(stretch, freq_hz=stretch.freq_hz[first : first + DAY_S])


def nothing_wrong(d: Draw) -> Trial:
    return Trial(d.clip(), [d.reference()], (d.start_s,), d.at(), True, honest=True)


def other_year(d: Draw) -> Trial:
    d.start_s = measured_start(d.other, d.seconds, d.rng)
    return Trial(d.clip(stretch=d.other), [d.reference()], claimed_ns=d.at(), honest=True)


def other_grid(d: Draw) -> Trial:
    files = sorted((DATA / "whu_reference_1s").glob("*.csv"))
    own = read_reference(files[d.seed % len(files)], step_s=1.0).freq_hz
    d.seconds = min(d.seconds, own.size - 80)
    d.start_s = 40.0
    return Trial(d.clip(stretch=Grid("whu", 50.0, 0, 1.0, own)), [d.reference()], honest=True)


def zone_of_claim(d: Draw) -> Trial:
    return Trial(d.clip(), [d.reference()], (d.start_s,), d.at(d.zone()))


def zone_of_reference(d: Draw) -> Trial:
    grid = d.reference(t0_ns=T0_NS + round(d.zone() * HOUR_NS))
    return Trial(d.clip(), [grid], (d.start_s,), d.at())


def wrong_step(d: Draw) -> Trial:
    step_s = float(d.rng.choice([0.5, 2.0]))
    return Trial(d.clip(), [dataclasses.replace(d.reference(t0_ns=0), step_s=step_s)])


def cut(d: Draw) -> Trial:
    first, second = d.split()
    out_s = float(np.exp(d.rng.uniform(np.log(1.0), np.log(3600.0))))
    clip = d.clip((0.0, first), (first + out_s, second))
    return Trial(clip, [d.reference()], (d.start_s,), d.at(), True)


def looped(d: Draw) -> Trial:
    first, second = d.split()
    back_s = float(d.rng.uniform(20.0, first))
    clip = d.clip((0.0, first), (first - back_s, second))
    return Trial(clip, [d.reference()], (d.start_s,), d.at(), True)


def joined(d: Draw) -> Trial:
    first, second = d.split()
    pieces = [Piece(d.day, d.start_s, first)]
    pieces += [Piece(d.other, measured_start(d.other, second, d.rng), second)]
    clip = edited_clip(pieces, d.seed, d.quality)
    return Trial(clip, [d.reference()], (d.start_s,), d.at(), True)


def dropped_frame(d: Draw) -> Trial:
    first, second = d.split()
    clip = d.clip((0.0, first), (first + 0.0333, second))
    return Trial(clip, [d.reference()], (d.start_s,), d.at(), True)


def samples_missing(d: Draw) -> Trial:
    first, _ = d.split()
    at, gone = int(d.start_s + first), int(d.rng.integers(2, 61))
    whole = d.reference(t0_ns=0)
    grid = dataclasses.replace(whole, freq_hz=np.delete(whole.freq_hz, slice(at, at + gone)))
    return Trial(d.clip(), [grid], (d.start_s, d.start_s - gone))


def speed(percent: float) -> Callable[[Draw], Trial]:
    def trial(d: Draw) -> Trial:
        d.quality = dataclasses.replace(d.quality, clock_ppm=(1 / (1 + percent / 100) - 1) * 1e6)
        return Trial(d.clip(), [d.reference()], (d.start_s,), d.at(), True)

    return trial


def reference_ends(d: Draw) -> Trial:
    """The reference begins two hours after the clip."""
    whole = d.reference()
    later = int(d.start_s) + 7200
    t0_ns = whole.t0_ns + later * 10**9
    grid = dataclasses.replace(whole, t0_ns=t0_ns, freq_hz=whole.freq_hz[later:])
    return Trial(d.clip(), [grid], claimed_ns=d.at(), claim_is_true=True)


MISTAKES: dict[str, Callable[[Draw], Trial]] = {
    "nothing wrong": nothing_wrong,
    "other year": other_year,
    "other grid": other_grid,
    "claim in another zone": zone_of_claim,
    "reference in another zone": zone_of_reference,
    "wrong step": wrong_step,
    "cut": cut,
    "looped": looped,
    "joined": joined,
    "a frame dropped": dropped_frame,
    "samples missing": samples_missing,
    "1.01 times the speed": speed(1.0),
    "0.99 times the speed": speed(-1.0),
    "1.001 times the speed": speed(0.1),
    "reference of another time": reference_ends,
}


def hints(result: MatchResult) -> list[str]:
    """Names of the mistakes that a result hints at."""
    said = " ".join([result.reason, *result.warnings])
    return [name for name, words in HINTS.items() if words in said]


def main(count: int, first_seed: int) -> None:
    confident = trials = 0
    for name, make in MISTAKES.items():
        verdicts, hinted, wrong = Counter(), Counter(), Counter()
        for seed in range(first_seed, first_seed + count):
            trial = make(Draw(seed))
            result = trial.result()
            verdicts[f"{result.decision}{result.claim and '/' + result.claim}"] += 1
            hinted.update(hints(result) or ["-"])
            error = trial.wrong(result)
            if error:
                wrong[error] += 1
                print(f"  seed {seed}: {name}: {error}", file=sys.stderr)
        trials, confident = trials + count, confident + wrong.total()
        print(f"{name:26s} {_counted(verdicts)}; hints {_counted(hinted)}; {_counted(wrong)}")
        sys.stdout.flush()
    print(f"{confident} of {trials} said something wrong with confidence")


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {n}" for name, n in counts.most_common())


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
