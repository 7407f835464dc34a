"""The paper's hypotheses: their lines, their order, what each publishes, and the tracker's own."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.messages import Header, canonical
from rsenf.rows.stage import blocks_from_luminance
from rsenf.track import METHODS, TrackSettings, make_tracker
from rsenf.track.paper_templates import IDLE_RATIOS, INTERPOLATIONS, hypotheses, paper_lines
from tests.track.test_paper_oracle import hypotheses_of, rows_of

RATE_HZ = 30000 / 1001


def places_hz(nominal_hz, rate_hz):
    return [round(abs(x.line_hz(rate_hz))) for x in paper_lines(nominal_hz, rate_hz, 1.0)]


@pytest.mark.parametrize(
    ("nominal_hz", "rate_hz", "expected"),
    [
        # As the paper lists them.
        (50.0, RATE_HZ, [10, 40, 70, 100, 130, 160, 190, 200]),
        (50.0, 30.0, [10, 40, 70, 100, 130, 160, 190, 200]),
        (50.0, 25.0, [25, 50, 75, 100, 125, 150, 175, 200]),
        # By its rule, and the lines that fold at 0 Hz with them.
        (60.0, 25.0, [5, 20, 30, 45, 55, 70, 80, 95, 105, 120, 130, 145, 155, 170, 180, 195,
                      205, 220, 230, 240]),
        (50.0, 24000 / 1001, [4, 20, 28, 44, 52, 68, 76, 92, 100, 116, 124, 140, 148, 164, 172,
                              188, 196, 200]),
        # Where those fall onto others, and none is left near 0 Hz.
        (60.0, 30.0, [30, 60, 90, 120, 150, 180, 210, 240]),
        (60.0, RATE_HZ, [30, 60, 90, 120, 150, 180, 210, 240]),
        (60.0, 24000 / 1001, [24, 48, 72, 96, 120, 144, 168, 192, 216, 240]),
    ],
)  # fmt: skip
def test_lines(nominal_hz, rate_hz, expected):
    assert places_hz(nominal_hz, rate_hz) == expected


def test_a_measured_frame_rate_gives_the_published_lines_too():
    for rate_hz in (24.9996, 25.0004):
        assert places_hz(50.0, rate_hz) == places_hz(50.0, 25.0)
    for rate_hz in (29.9697, 29.9703, 29.9996, 30.0004):
        assert places_hz(50.0, rate_hz) == places_hz(50.0, 30.0)


def test_the_line_at_twice_f0_is_the_second_harmonic():
    (line,) = (x for x in paper_lines(50.0, 25.0, 1.0) if x.line_hz(25.0) == 200.0)
    assert (line.harmonic, line.m) == (2, 0)


def test_hypotheses_are_every_line_under_every_idle_ratio():
    tried = hypotheses(50.0, 30.0, 1.0)
    assert len(tried) == 8 * 20
    assert [h.idle_ratio for h in tried[:20]] == [round(0.05 * i, 2) for i in range(20)]
    assert tried[0].period_rows(720) == 720
    assert tried[9].period_rows(720) == round(720 / 0.55)
    assert len(IDLE_RATIOS) == 20


def test_each_window_publishes_every_hypothesis_and_then_its_own():
    level, t_s = rows_of(RATE_HZ, 50.0, swing_hz=0.01)
    stage = make_tracker(TrackSettings(method="paper", nominal_hz=50.0))
    out = [
        e
        for b in blocks_from_luminance(level[:, :, None], t_s, Header(source="t/c"))
        for e in stage.update(b)
    ]
    out += stage.flush()
    windows = len(out) // 161
    assert [e.rank for e in out] == [*range(1, 161), 0] * windows
    assert [e.header.seq for e in out] == list(range(len(out)))
    assert [e.t_s for e in out[::161]] == pytest.approx([10.0 + k for k in range(windows)])
    tried = hypotheses(50.0, RATE_HZ, 1.0)
    for e, h in zip(out, tried, strict=False):
        assert (e.idle_ratio, e.line_m, e.harmonic) == (h.idle_ratio, h.line.m, h.line.harmonic)
        assert e.line_hz == pytest.approx(h.line.line_hz(RATE_HZ), abs=0.01)
        assert e.usable
    own = [e for e in out if e.rank == 0]
    assert all(e.usable and abs(e.enf_hz - 50.0) < 0.011 for e in own)


@pytest.mark.parametrize(("nominal_hz", "rate_hz"), [(50.0, RATE_HZ), (60.0, 25.0), (50.0, 24.0)])
def test_a_constant_grid_is_read_at_all_lines_that_are_there(nominal_hz, rate_hz):
    t_s = np.arange(int(22 * rate_hz)) / rate_hz
    at_s = t_s[:, None] + 0.6 / rate_hz * np.arange(20) / 20
    angle = 2 * np.pi * 2 * (nominal_hz + 0.031) * at_s
    level = (100 + 5 * np.cos(angle) + np.cos(2 * angle)).astype(np.float32)
    found = hypotheses_of(level, t_s, nominal_hz=nominal_hz)
    errors = [abs(es[0].enf_hz - nominal_hz - 0.031) for r, es in found.items() if r]
    assert np.mean(np.array(errors) < 1e-3) > 0.9


def test_the_tracker_finds_the_grid_for_itself():
    for nominal_hz in (50.0, 60.0):
        level, t_s = rows_of(RATE_HZ, nominal_hz + 0.02, swing_hz=0.003)
        found = hypotheses_of(level, t_s)
        assert len(found) == 1 + 20 * (8 + 8)
        assert {e.nominal_hz for e in found[0] if e.usable} == {nominal_hz}


def test_its_own_claim_needs_a_signal():
    rng = np.random.default_rng(3)
    level = (100 + rng.normal(0, 1, (700, 16))).astype(np.float32)
    found = hypotheses_of(level, np.arange(700) / RATE_HZ, nominal_hz=50.0)
    assert not any(e.usable for e in found[0])
    assert all(e.reason and np.isnan(e.enf_hz) for e in found[0])
    assert all(e.usable for e in found[1])  # a hypothesis claims nothing


def test_a_window_without_its_frames_is_one_message():
    level, t_s = rows_of(RATE_HZ, 50.0)
    keep = np.flatnonzero((t_s < 8) | (t_s > 14))
    (block,) = blocks_from_luminance(level[keep, :, None], t_s[keep], Header(), block_frames=999)
    stage = make_tracker(TrackSettings(method="paper", nominal_hz=50.0))
    out = stage.update(dataclasses.replace(block, frame_number=keep)) + stage.flush()
    assert len(out) == 3
    assert all(e.rank == 0 and "frames are there" in e.reason for e in out)


def test_one_mean_per_frame_has_no_rows():
    t_s = np.arange(700) / RATE_HZ
    level = 100 + np.cos(2 * np.pi * 100.02 * t_s)[:, None].astype(np.float32)
    found = hypotheses_of(level, t_s)
    assert list(found) == [0]
    assert all("no rows" in e.reason for e in found[0])


def test_streaming_equals_batch_bit_for_bit():
    level, t_s = rows_of(RATE_HZ, 50.02)
    blocks = list(blocks_from_luminance(level[:, :, None], t_s, Header(source="t/c")))
    one, other = (make_tracker(TrackSettings(method="paper", nominal_hz=50.0)) for _ in range(2))
    waiting = [e for b in blocks for e in one.update(b)] + one.flush()
    streamed = []
    for block in blocks:
        got = other.update(block)
        assert len(got) in (0, 161)  # as soon as its window is full
        streamed += got
    streamed += other.flush()
    assert [canonical(e) for e in streamed] == [canonical(e) for e in waiting]


def test_memory_is_bounded():
    stage = METHODS["paper"](TrackSettings(method="paper", nominal_hz=50.0))
    t_s = np.arange(1800) / 30.0
    level = np.full((1800, 4, 1), 100.0, np.float32)
    for block in blocks_from_luminance(level, t_s, Header()):
        stage.update(block)
    assert stage._buffer._value.shape[0] <= 2048
    assert all(len(one._hops) == 20 for one in stage._spectra)


def test_what_cannot_be_asked_for_is_refused():
    with pytest.raises(UsageError, match="no interpolation 'cubic'"):
        TrackSettings(method="paper", interpolation="cubic")
    with pytest.raises(UsageError, match="takes no line: tries every line"):
        METHODS["paper"].check(TrackSettings(method="paper", line_m=-1))
    with pytest.raises(UsageError, match="whole number of hops"):
        make_tracker(TrackSettings(method="paper", hop_s=0.3))
    assert set(INTERPOLATIONS) >= {"neighbour_mean", "linear", "harmonic", "none"}
