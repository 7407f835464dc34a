"""The stretch of a grid in whose light a feed is, and what a monitor is told of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from rsenf.bench.calibration.grids import Stretch, stretches
from rsenf.messages import Header, ReferenceBlock
from rsenf.messages.schema import FloatArray
from rsenf.model import GridPath, synthetic_grid
from rsenf.model.seeds import generator
from rsenf.timebase import nanoseconds

PAST_S = 3600.0  # of the reference, known when the feed begins
MARGIN_S = 30.0
NOISE_HZ = 0.3e-3
STEP_HZ = 1e-4  # that published values are rounded to
LATE_S = 0.5  # of a reference's sample, after its end
_SYNTHETIC_S = 3 * 3600.0
# Host's clock at the first sample of any stretch; all clocks of a study count from it.
T0_NS = 1_767_225_600 * 10**9


@dataclass(frozen=True, eq=False)
class Watched:
    """A stretch of a grid, and the times in it at which footage and feed begin (s)."""

    stretch: Stretch
    footage_s: float
    feed_s: float

    def path(self, start_s: float) -> GridPath:
        """Return the light's frequency as seen from a camera that starts then."""
        of = self.stretch
        return GridPath(of.freq_hz, of.step_s, start_s, of.nominal_hz)


def watched_grid(
    folder: Path | None, part: str, seed: int, lead_s: float, length_s: float
) -> Watched:
    """Draw where in which grid a feed is.

    Parameters
    ----------
    folder : Path or None
        Of the measured data; without it the grid is synthetic.
    part : {'fit', 'test'}
    seed : int
        Of the feed.
    lead_s : float
        Of footage before the feed begins.
    length_s : float
        Of the feed.
    """
    rng = generator(seed, f"live grid {part}")
    before_s, after_s = max(PAST_S, lead_s) + MARGIN_S, length_s + MARGIN_S
    if folder is None:
        stretch = _synthetic(int(rng.integers(2**31)), float(rng.choice([50.0, 60.0])))
    else:
        everything = stretches(folder, part)
        # Half of the feeds are in the first, which is as long as all the others are varied.
        other = int(rng.integers(1, len(everything)))
        stretch = everything[0 if rng.random() < 0.5 else other]
    while True:
        at_s = float(rng.uniform(before_s, stretch.freq_hz.size * stretch.step_s - after_s))
        first, last = (int((at_s + s) / stretch.step_s) for s in (-lead_s - MARGIN_S, after_s))
        if np.isfinite(stretch.freq_hz[first:last]).all():
            return Watched(stretch, at_s - lead_s, at_s)


def _synthetic(seed: int, nominal_hz: float) -> Stretch:
    path = synthetic_grid(seed, _SYNTHETIC_S, nominal_hz=nominal_hz)
    return Stretch("synthetic", nominal_hz, path.step_s, path.freq_hz)


def reference_blocks(watched: Watched, length_s: float, seed: int) -> Iterator[ReferenceBlock]:
    """Yield the reference as it arrives: the past at once, then each sample when it has ended.

    It has noise of its own and is rounded: light and reference would be the same numbers otherwise.
    """
    of = watched.stretch
    begin = int((watched.feed_s - PAST_S) / of.step_s)
    now = int(watched.feed_s / of.step_s)
    end = int((watched.feed_s + length_s) / of.step_s) + 1
    noisy = of.freq_hz[begin:end]
    noise_hz = NOISE_HZ / np.sqrt(of.step_s)
    noisy = noisy + noise_hz * generator(seed, "live reference").standard_normal(noisy.size)
    freq_hz = np.round(noisy / STEP_HZ) * STEP_HZ
    cuts = [0, *range(now - begin, end - begin + 1)]
    for seq, (first, stop) in enumerate(pairwise(cuts)):
        yield _block(of, begin, freq_hz, slice(first, stop), seq)


def _block(of: Stretch, begin: int, freq_hz: FloatArray, part: slice, seq: int) -> ReferenceBlock:
    step_ns = nanoseconds(of.step_s)
    t0_ns = T0_NS + begin * step_ns
    freq = freq_hz[part]
    return ReferenceBlock(
        header=Header(
            source=f"reference/{of.name}",
            seq=seq,
            pts_ns=part.start * step_ns,
            arrival_time_ns=t0_ns + part.stop * step_ns + nanoseconds(LATE_S),
        ),
        grid=of.name,
        nominal_hz=of.nominal_hz,
        t0_ns=t0_ns,
        step_ns=step_ns,
        first=part.start,
        samples=freq.size,
        total=0,
        freq_hz=freq,
        readings=np.isfinite(freq).astype(np.uint32),
    )
