"""What is claimed where there is nothing to claim, and found where there is: both, by seeds.

``python -m tests.flicker.claims FIRST LAST [TRACK_METHOD [IDLE_METHOD]]`` films every kind of
:mod:`tests.flicker.no_mains`, and as many lamps of :mod:`tests.flicker.weak_lamps`, and counts.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from rsenf.api.shared import Recording, opened, row_settings, track_settings
from rsenf.idle import IdleSettings
from rsenf.messages import EnfEstimate, IdleEstimate
from rsenf.run.inline import analyse
from tests.flicker import no_mains, weak_lamps


@dataclass(frozen=True)
class Claims:
    """What the two commands say of a film."""

    track: list[EnfEstimate]
    idle: IdleEstimate

    @property
    def usable(self) -> list[EnfEstimate]:
        """Seconds of ENF that are claimed."""
        return [e for e in self.track if e.usable]


def claims(
    recording: Recording,
    t_s: NDArray[np.float64] | None = None,
    track: str = "projection",
    idle: str = "coherent",
) -> Claims:
    """Let both look at a recording, or at rows and their times."""
    settings = track_settings({"method": track})
    source = opened(recording, t_s)
    rows = row_settings(None, settings)
    found = analyse(source, rows=rows, track=settings, idle=IdleSettings(idle))
    return Claims(found.estimates, found.idle)


def at_most(count: int, of: int) -> float:
    """Upper 95 % bound of a share (Clopper & Pearson)."""
    return 1.0 if count >= of else float(beta.ppf(0.95, count + 1, of - count))


def main(first: int, last: int, track: str, idle: str) -> None:
    total = np.zeros(3, int)
    for kind in no_mains.KINDS:
        seen = [claims(*no_mains.film(kind, seed), track, idle) for seed in range(first, last)]
        enf = sum(bool(c.usable) for c in seen)
        ratio = sum(c.idle.verdict == "estimated" for c in seen)
        total += (len(seen), enf, ratio)
        print(f"{kind:18s} {len(seen):4d} films: ENF {enf}, idle {ratio}", flush=True)
    films, *counts = total.tolist()
    told = ", ".join(f"{n} (95 % bound {100 * at_most(n, films):.2f} %)" for n in counts)
    print(f"{'all':18s} {films:4d} films: {told}")
    found, z, usable, seconds, covered, ratios = 0, [], 0, 0, 0, 0
    for seed in range(first, first + films):
        level, t_s, truth = weak_lamps.film(seed)
        c = claims(level, t_s, track, idle)
        found += bool(c.usable)
        usable, seconds = usable + len(c.usable), seconds + len(c.track)
        if c.usable and track == "projection":
            at = np.array([int(e.t_s) for e in c.usable])
            own = at < truth["enf_hz"].size
            std_hz = np.sqrt([e.enf_var_hz2 for e in c.usable])
            off_hz = np.array([e.enf_hz for e in c.usable])[own] - truth["enf_hz"][at[own]]
            z.append(float(np.sqrt(np.mean((off_hz / std_hz[own]) ** 2))))
        if c.idle.verdict == "estimated":
            ratios += 1
            low, high = c.idle.idle_ratio_low, c.idle.idle_ratio_high
            covered += low <= truth["idle_ratio"] <= high
    print(f"lamps: ENF in {found} of {films}, {usable} of {seconds} s", end="")
    print(f", z {np.median(z):.2f}, over 3 in {sum(x > 3 for x in z)}" if z else "")
    print(f"lamps: idle in {ratios}, its 95 % interval holds {covered}")


if __name__ == "__main__":
    methods = [*sys.argv[3:], *("projection", "coherent")[len(sys.argv) - 3 :]]
    main(int(sys.argv[1]), int(sys.argv[2]), methods[0], methods[1])
