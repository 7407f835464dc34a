"""Windows of a fixed length on films converted to another frame rate: nothing is said."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import rsenf
from rsenf.flicker.conversions import Conversions
from rsenf.flicker.rate_conversion import BLENDED, DOUBTFUL
from rsenf.messages import EnfEstimate, Header
from rsenf.model import synthetic_grid
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from tests.discrepancy.foreign_camera import Case, film
from tests.discrepancy.foreign_camera.trials import trial
from tests.flicker.foreign_rows import follow

METHODS = ("stft", "phase", "superpixel", "row_concat")


def _tracked(method: str, *hidden: str, seed: int) -> list[EnfEstimate]:
    case = Case(
        hidden=hidden, seed=seed, rate="30", nominal_hz=50.0, rows=240, strips=2, duration_s=22.0,
        lamp="led",
    )  # fmt: skip
    filmed = film(case)
    tracker = make_tracker(TrackSettings(method=method))
    blocks = blocks_from_luminance(filmed.level, filmed.stamp_s, Header())
    said = [*itertools.chain.from_iterable(map(tracker.update, blocks)), *tracker.flush()]
    return [m for m in said if isinstance(m, EnfEstimate)]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("hidden", "seed"), [("converted", 1), ("converted", 3), ("blended", 5)])
def test_nothing_is_said_of_a_converted_film(method: str, hidden: str, seed: int) -> None:
    said = _tracked(method, hidden, seed=seed)
    assert said
    assert not any(m.usable for m in said)
    told = BLENDED if hidden == "blended" else "frames were dropped or doubled"
    assert any(m.reason.startswith(told) for m in said)


@pytest.mark.parametrize("method", METHODS)
def test_what_is_not_converted_is_answered(method: str) -> None:
    assert any(m.usable for m in _tracked(method, seed=2))


@pytest.mark.parametrize(("kind", "seed"), [("second harmonic", 31080), ("stamp jitter", 31297)])
def test_overtones_that_a_short_beat_makes_as_well_are_not_undone(kind: str, seed: int) -> None:
    """As if 50 frames/s had become 30, the light would be a 60 Hz grid's: 10 Hz off."""
    made = follow(trial(kind, seed, rate="30", nominal_hz=50.0, grid="rough", duration_s=60.0))
    assert np.abs(made.off_hz).max(initial=0.0) < 5e-3
    assert made.rms_z < 2.0


def test_a_short_beat_is_doubtful() -> None:
    filmed = film(trial("second harmonic", 31080, rate="30", nominal_hz=50.0, grid="rough"))
    blocks = list(blocks_from_luminance(filmed.level[:600], filmed.stamp_s[:600], Header()))
    looked = Conversions((50.0, 60.0), blocks[0], 30.0)
    for block in blocks:
        looked.add(block)
    assert looked.why_not(0.0, 20.0) == DOUBTFUL


def test_the_rate_of_a_camera_that_is_off_is_doubted() -> None:
    made = follow(
        trial(
            "converted", 31020, rate="60.02", nominal_hz=50.0, grid="continental", duration_s=60.0
        )
    )
    assert made.off_hz.size > 20
    assert made.rms_z < 2.0


def test_the_grid_that_was_named_stays_where_a_conversion_is_undone() -> None:
    """Of 25 frames/s, of which every fifth is shown twice, 100 Hz stands still; 120 Hz doesn't."""
    grid_hz = synthetic_grid(seed=5, duration_s=60).freq_hz
    clip = rsenf.simulate(
        reference=grid_hz, step_s=1.0, duration_s=40, size=(64, 240), frame_rate="25", seed=3
    )
    count = int(len(clip.rows) * 1.2) - 2
    shown = clip.rows[np.floor(np.arange(count) / 1.2 + 0.3).astype(int)]
    for named, found in ((None, {50.0}), (60.0, set())):
        held = rsenf.track(shown, frame_time_s=np.arange(count) / 30.0, nominal_hz=named)
        assert {e.nominal_hz for e in held.analysis.estimates if e.usable} == found


def test_blends_do_no_harm_where_the_grid_is_given_and_its_light_stands_still() -> None:
    """As of encoders that mix neighbours, in the beat of 60 frames/s made 50."""
    rng = np.random.default_rng(3)
    t_s = np.arange(2000) / 50.0
    turned = 4.0 * np.pi * np.cumsum(0.02 + 0.01 * np.sin(t_s / 6.0)) / 50.0
    at = turned[:, None] + 2.0 * np.pi * 1.6 * np.arange(240) / 240
    clean = rng.uniform(80.0, 120.0, 240) * (1.0 + 0.08 * np.cos(at))
    noise = rng.standard_normal((2401, 240, 8))
    of = np.arange(t_s.size) * 6 // 5
    share = (np.arange(t_s.size) % 5 / 5.0)[:, None, None]
    level = clean[..., None] + (1.0 - share) * noise[of] + share * noise[of + 1]
    given = rsenf.track(level, frame_time_s=t_s, nominal_hz=50.0)
    usable = given.usable
    true_hz = 50.02 + 0.01 * np.sin(given.t_s / 6.0)
    assert usable.mean() > 0.9
    off_hz = given.enf_hz - true_hz
    z = np.minimum(np.abs(off_hz), np.abs(given.enf_hz - 100.0 + true_hz)) / given.enf_std_hz
    assert np.sqrt(np.mean(z[usable] ** 2)) < 2.0
    assert not rsenf.track(level, frame_time_s=t_s).usable.any()
