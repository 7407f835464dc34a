"""The paper's tracker against the slow way: the interpolated series made and transformed."""

from __future__ import annotations

import dataclasses
import itertools
from collections import defaultdict

import numpy as np
import pytest

from rsenf.messages import EnfEstimate, Header
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker
from rsenf.track.paper_templates import INTERPOLATIONS, PaperTemplates, hypotheses
from tests.oracle.interpolated_series import enf_of, periods_of

WINDOWS = 2
TOLERANCE_HZ = 0.11e-3
ROWS = 20


def rows_of(rate_hz, grid_hz, *, idle=0.4, seed=0, swing_hz=0.04):
    """Rows under a lamp of two harmonics, on a grid that swings in half a minute."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(int((20 + WINDOWS) * rate_hz)) / rate_hz
    at_s = t_s[:, None] + (1 - idle) / rate_hz * np.arange(ROWS) / ROWS
    cycles = grid_hz * at_s + swing_hz * 30 / (2 * np.pi) * np.sin(2 * np.pi * at_s / 30 + seed)
    light = np.cos(4 * np.pi * cycles) + 0.3 * np.cos(8 * np.pi * cycles)
    level = rng.uniform(90, 130, ROWS) + 4 * light + rng.normal(0, 0.2, at_s.shape)
    return level.astype(np.float32), t_s


def hypotheses_of(level, t_s, **settings):
    """Estimates by rank."""
    stage = make_tracker(TrackSettings(method="paper", **settings))
    blocks = blocks_from_luminance(level[:, :, None], t_s, Header(source="t/c"))
    found: dict[int, list[EnfEstimate]] = defaultdict(list)
    for e in [*itertools.chain.from_iterable(map(stage.update, blocks)), *stage.flush()]:
        found[e.rank].append(e)
    return found


@pytest.mark.parametrize(
    ("interpolation", "rate_hz", "nominal_hz", "away_hz"),
    [
        *((name, 30000 / 1001, 50.0, 0.0) for name in INTERPOLATIONS),
        ("linear", 24000 / 1001, 50.0, 0.0),
        ("linear", 30000 / 1001, 60.0, 0.0),
        # Every line is two tones here, mirrored about it: apart enough to be two peaks.
        ("linear", 25.0, 50.0, 0.3),
    ],
)
def test_the_fast_way_equals_the_slow_one(interpolation, rate_hz, nominal_hz, away_hz):
    """Line by line, under a few idle ratios each.

    The fast way holds a line's ramp down the rows at its nominal place; the slow way's turns with
    the frequency that is looked at, so the line's amplitude ``A`` changes across its peak and
    moves it, by ``(d ln A/df) / ((2π)²·σ²)`` with ``σ² = 0.033·W²`` for a Hann window. The place
    within a frame period spreads by 0.29/F_r, so ``dA/df`` is at most ``2π·0.29/F_r`` of the
    series' rms, and the peak at most 0.104 mHz of the ENF off at 24 frames/s, over the line's
    share of the series' amplitude.
    """
    level, t_s = rows_of(rate_hz, nominal_hz + away_hz)
    found = hypotheses_of(level, t_s, nominal_hz=nominal_hz, interpolation=interpolation)
    compared = 0
    for rank in range(1, len(found), 17):
        one = found[rank][0]
        slow, share = enf_of(
            level.astype(float),
            rate_hz,
            nominal_hz=nominal_hz,
            harmonic=one.harmonic,
            line_hz=2 * nominal_hz * one.harmonic + one.line_m * rate_hz,
            idle_ratio=one.idle_ratio,
            interpolation=interpolation,
            windows=WINDOWS,
        )
        fast = np.array([e.enf_hz for e in found[rank][:WINDOWS]])
        if share.min() > 0.1:
            compared += 1
            assert np.abs(fast - slow).max() < TOLERANCE_HZ / share.min(), one.line_hz
    assert compared >= 3


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_a_frames_value_is_the_sum_over_its_period(interpolation):
    """At the line's own place, where both ways are the same sum: to rounding."""
    level, t_s = rows_of(25.0, 60.0)
    (block,) = blocks_from_luminance(level[:9, :, None], t_s[:9], Header(), block_frames=9)
    tried = hypotheses(60.0, 25.0, 1.0)
    fast = PaperTemplates(tried, 25.0, ROWS, interpolation).reduce(block)
    for column, one in list(enumerate(tried))[::3]:
        series = periods_of(level[:9].astype(float), 25.0, 60.0, one.idle_ratio, interpolation)
        period = series.shape[1]
        place = np.arange(period) - (period - ROWS)
        ramp = np.exp(-2j * np.pi * one.line.line_hz(25.0) / (period * 25.0) * place)
        slow = series @ ramp / ROWS
        assert fast[:, column] == pytest.approx(slow, rel=1e-6, abs=1e-6)


def test_beside_a_frame_that_never_came_nothing_is_interpolated():
    level, t_s = rows_of(30.0, 50.0)
    kept = np.delete(np.arange(len(t_s)), [250, 251, 400])
    (block,) = blocks_from_luminance(level[:, :, None], t_s, Header(), block_frames=len(t_s))
    holed = dataclasses.replace(
        block,
        frames=kept.size,
        level=block.level[kept],
        frame_number=block.frame_number[kept],
        frame_pts_ns=block.frame_pts_ns[kept],
    )
    tried = hypotheses(50.0, 30.0, 1.0)
    of_all = PaperTemplates(tried, 30.0, ROWS, "neighbour_mean").reduce(block)
    of_kept = PaperTemplates(tried, 30.0, ROWS, "neighbour_mean").reduce(holed)
    rows_only = PaperTemplates(tried, 30.0, ROWS, "none").reduce(block)
    after_hole = np.isin(kept, [0, 252, 401])
    assert np.allclose(of_kept[after_hole], rows_only[kept][after_hole], rtol=0, atol=1e-12)
    assert np.allclose(of_kept[~after_hole], of_all[kept][~after_hole], rtol=0, atol=1e-12)
    assert np.abs(of_all - rows_only).max() > 1
