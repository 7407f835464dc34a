"""The stage: messages in any order and any pieces, claims, and results worth reading."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.match import Match, MatchSettings
from rsenf.messages import canonical
from tests.match.match_clips import (
    blocks_from,
    clip_of,
    estimates_from,
    grid_from,
    wandering_grid,
)

DAY = wandering_grid(12_000, seed=21)
T0_NS = 1_663_372_800_000_000_000
START_S = 4000.5
GRID = grid_from(DAY, t0_ns=T0_NS)
CLIP = clip_of(DAY, START_S, 240, 1, ppm=70)


def run(messages, **settings):
    """These clips are windows of 20 s, which only a correlation can compare."""
    stage = Match(method="ncc", **settings)
    return [r for m in messages for r in stage.update(m)] + stage.flush()


def claim(start_s, clip=CLIP, grid=GRID):
    claimed_ns = T0_NS + round(start_s * 1e9)
    messages = [*blocks_from(grid), *estimates_from(clip)]
    return run(messages, claimed_utc_ns=claimed_ns)[-1]


def test_result_is_complete():
    (result,) = run([*blocks_from(GRID), *estimates_from(CLIP)])
    assert result.final
    assert (result.decision, result.method, result.grid) == ("match", "ncc", "test")
    assert result.lag_s == pytest.approx(START_S, abs=0.5)
    assert result.start_utc_ns == T0_NS + round(result.lag_s * 1e9)
    assert result.candidates[0].start_utc_ns == result.start_utc_ns
    assert result.clock_ppm == pytest.approx(70, abs=10)
    assert (result.claim, result.claimed_utc_ns) == ("", 0)
    assert result.expected_std_hz > 0
    assert result.header.source == "site/cam"
    assert result.warnings == ()


def test_order_of_the_two_streams_does_not_matter():
    blocks, estimates = blocks_from(GRID), estimates_from(CLIP)
    rng = np.random.default_rng(2)
    runs = [blocks + estimates, estimates + blocks]
    mixed, b, e = [], list(blocks), list(estimates)
    while b or e:
        mixed.append((b if b and (not e or rng.random() < 0.1) else e).pop(0))
    runs.append(mixed)
    results = [[canonical(r) for r in run(m, interim_every_s=60)] for m in runs]
    assert results[0] == results[1] == results[2]


def test_interim_results_come_at_stream_time():
    results = run([*blocks_from(GRID), *estimates_from(CLIP)], interim_every_s=60)
    assert [r.final for r in results] == [False, False, False, False, True]
    assert [r.seconds_used for r in results] == [41, 101, 161, 221, 221]
    assert [r.header.seq for r in results] == [0, 1, 2, 3, 4]
    assert [r.decision for r in results][:1] == ["no_decision"]


def test_interim_results_of_a_long_clip_wait_for_a_quarter_more_of_it():
    messages = [*blocks_from(GRID), *estimates_from(CLIP)]
    *interim, _ = run(messages, interim_every_s=20)
    assert [r.seconds_used for r in interim[2:]] == [20 * k - 19 for k in (3, 4, 5, 7, 9, 12)]
    *of_a_minute, _ = run(messages, interim_every_s=20, keep_hours=1 / 60)
    assert len(of_a_minute) == 12


def test_a_growing_reference_is_used_as_far_as_it_is():
    growing = [dataclasses.replace(b, total=0) for b in blocks_from(GRID)]
    estimates = estimates_from(CLIP)
    results = run(
        [*growing[:9], *estimates[:150], *growing[9:], *estimates[150:]], interim_every_s=100
    )
    assert [r.final for r in results] == [False, False, True]
    assert results[0].search_size < results[-1].search_size


def test_hypotheses_other_than_the_trackers_own_are_ignored():
    wrong = [dataclasses.replace(e, rank=1, enf_hz=49.9) for e in estimates_from(CLIP)]
    both = [e for pair in zip(estimates_from(CLIP), wrong, strict=True) for e in pair]
    (plain,) = run([*blocks_from(GRID), *estimates_from(CLIP)])
    (mixed,) = run([*blocks_from(GRID), *both])
    assert canonical(plain) == canonical(mixed)


def test_a_new_epoch_is_another_clip():
    other = clip_of(DAY, 9000.25, 200, 5)
    messages = [*blocks_from(GRID), *estimates_from(CLIP), *estimates_from(other, epoch=1)]
    first, second = run(messages)
    assert (first.header.epoch, second.header.epoch) == (0, 1)
    assert first.lag_s == pytest.approx(START_S, abs=0.5)
    assert second.lag_s == pytest.approx(9000.25, abs=0.5)
    assert first.header.seq == second.header.seq == 0


def test_a_claim_is_of_the_first_stretch_alone():
    later = clip_of(DAY, START_S + 300, 200, 5)
    messages = [*blocks_from(GRID), *estimates_from(CLIP), *estimates_from(later, epoch=1)]
    claimed_ns = T0_NS + round(START_S * 1e9)
    first, second = run(messages, claimed_utc_ns=claimed_ns)
    assert (first.claim, second.decision, second.claim) == ("supported", "match", "undecidable")
    assert first.claimed_utc_ns == second.claimed_utc_ns == claimed_ns
    assert any("the claim is of its first stretch" in w for w in second.warnings)


@pytest.mark.parametrize("zone_h", [5.75, 12.75, -3.5, 1.0])
def test_a_zone_that_is_unknown_refutes_no_claim(zone_h):
    grid = dataclasses.replace(GRID, zone_unknown=True)
    shifted = dataclasses.replace(grid, t0_ns=T0_NS + round(zone_h * 3600e9))
    stage = Match(method="ncc", grids=[shifted], claimed_utc_ns=T0_NS + round(START_S * 1e9))
    for message in estimates_from(CLIP):
        stage.update(message)
    (result,) = stage.flush()
    assert (result.decision, result.claim) == ("match", "undecidable")


def test_only_the_grid_asked_for_counts():
    other = [dataclasses.replace(b, grid="elsewhere") for b in blocks_from(GRID)]
    (result,) = run([*other, *estimates_from(CLIP)], grid="test")
    assert (result.decision, result.reason) == ("no_decision", "no reference")
    (result,) = run([*other, *blocks_from(GRID), *estimates_from(CLIP)], grid="test")
    assert (result.decision, result.grid) == ("match", "test")


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (list, "shorter than one window"),
        (lambda: estimates_from(CLIP)[:20], "only 20 usable seconds"),
        (
            lambda: [dataclasses.replace(e, usable=False) for e in estimates_from(CLIP)],
            "no usable signal",
        ),
        (
            lambda: [
                dataclasses.replace(e, nominal_hz=60.0, enf_hz=e.enf_hz + 10)
                for e in estimates_from(CLIP)
            ],
            "a 60 Hz grid",
        ),
    ],
)
def test_what_cannot_be_decided_says_why(make, reason):
    (result,) = run([*blocks_from(GRID), *make()])
    assert result.decision == "no_decision"
    assert reason in result.reason
    assert np.isnan(result.lag_s)
    assert result.final


def test_claims():
    assert claim(START_S).claim == "supported"
    assert claim(START_S + 0.8).claim == "supported"
    assert claim(START_S + 30).claim == "refuted"
    assert claim(-1e6).claim == "refuted"  # the clip is elsewhere
    assert "off by just" not in " ".join(claim(START_S + 1800).warnings)
    (warning,) = claim(START_S + 7200).warnings
    assert "off by just -2 h" in warning


def test_claims_that_cannot_be_tested():
    unknown = claim(START_S, grid=grid_from(DAY))
    assert unknown.claim == "undecidable"
    assert "start time isn't known" in unknown.warnings[0]
    assert unknown.start_utc_ns == 0
    gap = DAY.copy()
    gap[3900:4400] = np.nan
    assert claim(START_S, grid=grid_from(gap, t0_ns=T0_NS)).claim == "undecidable"
    absent = clip_of(wandering_grid(3000, seed=77), 1000, 900, 5)
    assert claim(5000, clip=absent).claim == "refuted"
    assert claim(50_000, clip=absent).claim == "undecidable"


def test_missing_reference_is_mentioned():
    gap = DAY.copy()
    gap[4100:4120] = np.nan
    (result,) = run([*blocks_from(grid_from(gap)), *estimates_from(CLIP)])
    assert result.decision == "match"
    text = " / ".join(result.warnings)
    assert "usable seconds of the clip have no reference" in text
    gap[6000:8000] = np.nan
    (result,) = run([*blocks_from(grid_from(gap)), *estimates_from(CLIP)])
    assert any("of the possible times fall into gaps" in w for w in result.warnings)


def test_a_clock_beyond_belief_is_mentioned():
    clip = clip_of(DAY, START_S, 600, 1, ppm=260)
    (result,) = run([*blocks_from(GRID), *estimates_from(clip)])
    assert result.lag_s == pytest.approx(START_S, abs=0.5)
    assert any("unusual for a camera" in w for w in result.warnings)


def test_misuse_is_refused():
    with pytest.raises(UsageError, match="metric9"):
        Match(method="metric9")
    with pytest.raises(UsageError, match="smoothing"):
        MatchSettings(smoothing="a lot")
    with pytest.raises(UsageError, match="overlap"):
        MatchSettings(min_overlap=0)
    with pytest.raises(UsageError, match="clock_scale_ppm of 0: above 0"):
        MatchSettings(clock_scale_ppm=0)
    with pytest.raises(UsageError, match="candidates of -1: 0 or more"):
        MatchSettings(candidates=-1)
    with pytest.raises(UsageError, match="min_log10_lr of -5: 0 or more"):
        MatchSettings(min_log10_lr=-5)
    with pytest.raises(UsageError, match="max_chance of nan: above 0"):
        MatchSettings(max_chance=float("nan"))


def test_only_the_last_hours_are_kept():
    estimates = estimates_from(CLIP)
    stage = Match(method="ncc", keep_hours=0.05)
    for message in [*blocks_from(GRID), *estimates]:
        stage.update(message)
    assert stage._estimates.rows.size < 210
    (result,) = stage.flush()
    assert result.decision == "match"
    # It still tells when the clip began, though that is forgotten.
    assert result.lag_s == pytest.approx(START_S, abs=0.6)
    assert result.warnings == ("longer than 0.05 h: compared by what came last",)


def test_one_window_is_kept_though_it_is_longer():
    stage = Match(method="ncc", keep_hours=0.005)
    for message in [*blocks_from(GRID), *estimates_from(CLIP)]:
        stage.update(message)
    assert stage._estimates.rows.size >= 1


def test_of_a_growing_reference_too():
    stage = Match(keep_hours=0.5)
    for block in blocks_from(GRID):
        stage.update(dataclasses.replace(block, total=0))
    held = sum(block.samples for block in stage._blocks["test"].values())
    assert 1800 <= held < 1800 + 2 * max(b.samples for b in stage._blocks["test"].values())


def test_what_does_not_fit_is_an_error_or_refused():
    odd = grid_from(DAY[:6000], t0_ns=T0_NS, step_s=1.7)
    messages = [*blocks_from(odd), *estimates_from(CLIP)]
    with pytest.raises(UsageError, match="no whole multiple"):
        run(messages)
    said = []
    (result,) = run(messages, on_refused=said.append)
    assert result.decision == "no_decision"
    assert "no whole multiple" in result.reason
    assert said == [result.reason]


def test_wrong_peaks_of_a_tracker_do_not_hide_the_time():
    enf = CLIP.enf_hz.copy()
    wrong = np.random.default_rng(6).random(enf.size) < 0.04
    enf[wrong] += 0.1
    clip = dataclasses.replace(CLIP, enf_hz=enf)
    (result,) = run([*blocks_from(GRID), *estimates_from(clip)])
    assert result.decision == "match"
    assert result.lag_s == pytest.approx(START_S, abs=0.5)
    assert result.warnings == (
        f"estimates that jump away from their neighbours, left out: {wrong.sum()}",
    )
