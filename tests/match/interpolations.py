"""Which interpolation of the missing rows serves the paper's procedure best.

Not a test by itself: ``python -m tests.match.interpolations 3`` prints the table for 3 clips a
cell. Clips are row means of a minute, under lamps with and without harmonics, on the first half of
the 2022 day, which is the reference too; all seeds are development seeds. Of all hypotheses,
``agree`` is the share above ``TH_c`` at the right time, ``best`` and ``median`` the rms of the ENF
(mHz, its mean left out) against the reference as averaged by the window; ``right`` and ``wrong``
count what Metrics 2, 3 and 4 decide.
"""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsenf.match import MatchSettings, hypotheses_of, metric, paper_search
from rsenf.match.clip_phase import average, window_kernel
from rsenf.messages import Header
from rsenf.model import CaptureModel, GridPath, Light, Shutter, parse_frame_rate, simulate_rows
from rsenf.reference import read_reference
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from rsenf.track.paper_templates import INTERPOLATIONS
from tests.match.match_clips import grid_from

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
LAMPS = ("led", "halogen", "cfl", "incandescent")
RATES = ("29.97", "25", "23.976")
# Amplitude over the mean light: plain to see, and hardly above the noise of a row of 64 pixels.
FLICKER = {"strong": 0.1, "weak": 0.0005}
CLIP_S, WINDOW_S = 60.0, 20.0
METRICS = (2, 3, 4)


@dataclass(frozen=True, eq=False)
class Clip:
    """Row blocks, and where on the reference they begin."""

    blocks: list
    start_s: float


def film(rate: str, flicker: float, seed: int, grid_hz: np.ndarray) -> Clip:
    """One clip, drawn from its seed; the same for all interpolations."""
    rng = np.random.default_rng([seed, RATES.index(rate)])
    start_s = float(rng.uniform(60, grid_hz.size - CLIP_S - 60))
    model = CaptureModel(
        light=Light(lamp=LAMPS[seed % len(LAMPS)], flicker_ratio=flicker),
        shutter=Shutter(
            frame_rate=parse_frame_rate(rate), rows=120, columns=64,
            idle_ratio=float(rng.uniform(0.02, 0.75)),
        ),
    ).with_effect("exposure", exposure_s=1 / 500)  # fmt: skip
    rows = simulate_rows(model, GridPath(grid_hz, 1.0, start_s, 50.0), CLIP_S, seed)
    blocks = blocks_from_luminance(rows.level, rows.frame_time_s, Header(source="site/cam"))
    return Clip(list(blocks), start_s)


def judge(clip: Clip, interpolation: str, grid_hz: np.ndarray) -> dict[str, np.ndarray | float]:
    """What the procedure makes of a clip."""
    stage = make_tracker(
        TrackSettings(method="paper", nominal_hz=50.0, interpolation=interpolation)
    )
    estimates = [e for b in clip.blocks for e in stage.update(b)] + stage.flush()
    tally = paper_search(hypotheses_of(estimates), grid_from(grid_hz), MatchSettings())
    enf_hz = tally.hypotheses.enf_hz
    centre_s = clip.start_s + tally.hypotheses.first_s + np.arange(enf_hz.shape[1])
    smooth_hz = average(grid_hz, window_kernel(WINDOW_S, 1.0))
    error_hz = enf_hz - np.interp(centre_s - 0.5, np.arange(smooth_hz.size), smooth_hz)
    rms_mhz = 1e3 * error_hz.std(axis=1)
    near = np.abs(tally.lag_s - clip.start_s) <= 1.0
    above = tally.correlation > tally.settings.threshold_correlation
    decided = [metric(tally, number) for number in METRICS]
    right = [abs(f.lag_s - clip.start_s) <= 1.0 for f in decided]
    match = np.array([f.decision == "match" for f in decided])
    return {
        "agree": float(np.mean(near & above)),
        "best": float(rms_mhz.min()),
        "median": float(np.median(rms_mhz)),
        "right": match & right,
        "wrong": match & ~np.array(right),
    }


def main(count: int) -> None:
    grid_hz = read_reference(DATA / "grid_ce_2022-09-17_1s.csv.gz").freq_hz[:43_200]
    print(f"{'':36s} agree   best median   right {METRICS}   wrong")
    for rate, (strength, flicker) in itertools.product(RATES, FLICKER.items()):
        clips = [film(rate, flicker, seed, grid_hz) for seed in range(count)]
        for name in INTERPOLATIONS:
            found = [judge(clip, name, grid_hz) for clip in clips]
            mean = {key: np.mean([f[key] for f in found], axis=0) for key in found[0]}
            right, wrong = (
                " ".join(f"{n:3.0f}" for n in count * mean[key]) for key in ("right", "wrong")
            )
            print(
                f"{rate:>6s} fps, {strength:6s} {name:16s} {mean['agree']:6.1%} "
                f"{mean['best']:6.2f} {mean['median']:6.2f}   {right}      {wrong}",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]))
