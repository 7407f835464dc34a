"""Clips that were cut, looped or put together, and those of another speed: what is said of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.match import Match, MatchSettings
from rsenf.match.clip_phase import clip_phase
from rsenf.match.parts import Parts
from rsenf.match.phase_search import Place
from rsenf.match.series import without_jumps
from rsenf.timebase import utc_text
from tests.match.edited_clips import PLAIN, Piece, Quality, edited_clip, reference_of
from tests.match.match_clips import estimates_from
from tests.match.mistakes import hints
from tests.match.phase_clips import stretch_of

DAY, OTHER = stretch_of(7000, seed=11), stretch_of(3000, seed=12)
T0_NS = 1_663_372_800_000_000_000
GRID = reference_of(DAY, seed=1, t0_ns=T0_NS)
NO_TIMES = dataclasses.replace(GRID, t0_ns=0)
BEGIN_S = 3000.4


def clip_of_pieces(*pieces, seed=1, quality=PLAIN, stretch=DAY):
    """A clip of pieces of time: seconds after BEGIN_S, and length."""
    own = [Piece(stretch, BEGIN_S + begin, length) for begin, length in pieces]
    return edited_clip(own, seed, quality)


def verdict(track, *grids, start_s=None):
    claimed_ns = 0 if start_s is None else T0_NS + round(start_s * 1e9)
    stage = Match(grids=grids or (GRID,), claimed_utc_ns=claimed_ns)
    for estimate in estimates_from(track):
        stage.update(estimate)
    (result,) = stage.flush()
    return result


def said(result):
    return " / ".join(result.warnings)


def when(start_s):
    """A time to a tenth of a minute, as it stands in a warning."""
    return str(utc_text(T0_NS + round(start_s * 1e9)))[:18]


@pytest.mark.parametrize(
    ("first", "second", "out_s"), [(60, 120, 300.0), (90, 90, 20.0), (130, 60, 3.0)]
)
def test_a_clip_that_was_cut_names_both_times_and_what_is_missing(first, second, out_s):
    result = verdict(clip_of_pieces((0, first), (first + out_s, second)))
    assert result.decision == "no_decision"
    assert result.reason == "parts of the clip fit, but not as one recording"
    assert "cut and rejoined?" in said(result)
    assert f"fit from {when(BEGIN_S)}" in said(result)
    (missing,) = [w for w in result.warnings if "are missing" in w]
    words = missing.split()
    assert float(words[1]) == pytest.approx(first, abs=4)
    assert float(words[words.index("clip") + 1]) == pytest.approx(out_s, abs=0.5)


def test_two_stretches_that_tell_enough_only_together():
    """Neither would be found by itself in two hours; nobody says when the clip begins."""
    quality = Quality(noise_rad=0.03)
    result = verdict(clip_of_pieces((0, 40), (52, 40), quality=quality))
    assert (result.decision, [edit.kind for edit in result.edits]) == ("no_decision", ["cut"])
    (edit,) = result.edits
    assert edit.at_s == pytest.approx(40, abs=3)
    assert edit.size_s == pytest.approx(12, abs=3 * edit.size_std_s)
    assert edit.text in result.warnings
    first, second = result.segments
    assert second.lag_s - second.from_s - (first.lag_s - first.from_s) == pytest.approx(edit.size_s)
    assert first.start_utc_ns - T0_NS == pytest.approx(BEGIN_S * 1e9, abs=1e9)
    assert min(first.log10_lr, second.log10_lr) >= 2
    # The time told is that of a part, not of whatever a mixture of both fits best.
    assert min(abs(result.lag_s - BEGIN_S), abs(result.lag_s - BEGIN_S - 12)) < 1


def test_several_edits_are_told_in_their_order():
    pieces = (0, 70), (30, 60), (150, 80)
    result = verdict(clip_of_pieces(*pieces, seed=7))
    assert [edit.kind for edit in result.edits] == ["repeated", "cut"]
    assert [edit.at_s for edit in result.edits] == pytest.approx([70, 130], abs=3)
    assert [edit.size_s for edit in result.edits] == pytest.approx([40, 60], abs=0.5)
    assert [one.from_s for one in result.segments] == pytest.approx([0, 70, 130], abs=4)


def test_something_put_in_and_something_in_its_place():
    foreign = Piece(OTHER, 900.0, 40)
    for later_s, kind in ((0, "inserted"), (40, "replaced")):
        pieces = [Piece(DAY, BEGIN_S, 90), foreign, Piece(DAY, BEGIN_S + 90 + later_s, 90)]
        result = verdict(edited_clip(pieces, 8))
        (edit,) = result.edits
        assert edit.kind == kind
        assert edit.at_s == pytest.approx(90, abs=4)
        assert edit.size_s == pytest.approx(40, abs=0.5 if kind == "inserted" else 6)


def test_a_gap_of_the_reference_just_at_a_cut_is_no_place():
    """There a jump of the phase would count for nothing, and any other grid seem unlikely."""
    whole = GRID.freq_hz.copy()
    whole[1000:1010] = np.nan
    track, _ = without_jumps(clip_of_pieces((0, 40), (52, 40), seed=9))
    grid = dataclasses.replace(GRID, freq_hz=whole)
    found = Parts(track, clip_phase(track), [grid], MatchSettings())
    at_gap = Place(0, 1005.0 - 40.0, 0.3, 0.0)
    parts = found.found(at_gap)
    assert [part.place.lag_s - BEGIN_S for part in parts] == pytest.approx([0, 12], abs=0.5)


def test_a_loop():
    result = verdict(clip_of_pieces((0, 100), (0, 100)))
    assert result.decision == "no_decision"
    assert "from 100 s on the clip goes back by" in said(result)
    assert "looped?" in said(result)


def test_parts_in_another_order():
    result = verdict(clip_of_pieces((500, 90), (0, 90)))
    assert result.decision == "no_decision"
    assert "shows what was recorded before: rearranged?" in said(result)


def test_two_recordings_joined():
    pieces = [Piece(DAY, BEGIN_S, 120), Piece(OTHER, 900.0, 70)]
    result = verdict(edited_clip(pieces, 3))
    assert result.decision == "no_decision"
    assert "the clip's last 70 s don't fit" in said(result)
    assert f"fit from {when(BEGIN_S)}" in said(result)


def test_a_short_end_that_does_not_fit_leaves_the_time_as_it_is():
    pieces = [Piece(DAY, BEGIN_S, 240), Piece(OTHER, 900.0, 6)]
    result = verdict(edited_clip(pieces, 4))
    if result.decision == "match":
        assert result.lag_s == pytest.approx(BEGIN_S, abs=1)
    assert "s don't fit what is beside them" in said(result)


def test_a_frame_dropped_is_no_proof_of_another_time():
    for seed in range(3):
        track = clip_of_pieces((0, 80), (80.0333, 90), seed=seed)
        result = verdict(track, start_s=BEGIN_S)
        assert result.decision != "no_match"
        assert result.claim != "refuted"
        assert result.decision == "match" or "the light's phase jumps" in said(result)


def test_samples_missing_from_a_reference_without_times():
    gone = slice(int(BEGIN_S) + 90, int(BEGIN_S) + 120)
    grid = dataclasses.replace(NO_TIMES, freq_hz=np.delete(GRID.freq_hz, gone))
    result = verdict(clip_of_pieces((0, 200)), grid)
    assert result.decision == "no_decision"
    assert "missing from a reference without times?" in said(result)
    (warning,) = [w for w in result.warnings if "that the reference lacks" in w]
    assert "30." in warning or "29.9" in warning


def test_claims_of_an_edited_clip():
    track = clip_of_pieces((0, 90), (400, 90))
    assert verdict(track, start_s=BEGIN_S).claim == "undecidable"
    assert verdict(track, start_s=BEGIN_S - 2000).claim == "refuted"


def test_a_step_that_was_given_wrong():
    track = clip_of_pieces((0, 150))
    for wrong_s in (0.5, 2.0):
        result = verdict(track, dataclasses.replace(NO_TIMES, step_s=wrong_s))
        assert result.decision == "no_decision"
        assert f"with a step of 1 s instead of {wrong_s:g} s the reference would fit" in said(
            result
        )
        assert f"{BEGIN_S:.0f}" in said(result)
    assert "step" not in said(verdict(track, NO_TIMES))


@pytest.mark.parametrize("percent", [1.0, -1.0])
def test_another_speed_is_named_before_anything_is_searched(percent):
    quality = Quality(clock_ppm=(1 / (1 + percent / 100) - 1) * 1e6)
    result = verdict(clip_of_pieces((0, 100), quality=quality), start_s=BEGIN_S)
    assert (result.decision, result.claim) == ("no_decision", "undecidable")
    side = "above" if percent > 0 else "below"
    assert f"(1.0 %) {side} 50 Hz" in result.reason
    assert "played at another speed, or wrong frame times?" in result.reason


def test_a_grid_that_broke_down_is_searched():
    """Where the reference itself is that far off, the clip's ENF is no mistake."""
    low = dataclasses.replace(DAY, freq_hz=DAY.freq_hz - 0.3)
    result = verdict(clip_of_pieces((0, 120), stretch=low), reference_of(low, 1, t0_ns=T0_NS))
    assert "another speed" not in result.reason


@pytest.mark.parametrize("seconds", [60, 200])
@pytest.mark.parametrize("percent", [0.1, -0.1])
def test_frame_rates_taken_for_each_other(percent, seconds):
    quality = Quality(clock_ppm=(1 / (1 + percent / 100) - 1) * 1e6)
    result = verdict(clip_of_pieces((0, seconds), quality=quality), start_s=BEGIN_S)
    assert result.decision != "no_match"
    assert result.claim != "refuted"
    assert "30 and 29.97 frames/s differ" in said(result)
    for edit in result.edits:
        assert edit.kind == "speed"
        assert edit.speed_ratio == pytest.approx(1 + percent / 100, abs=2e-4)
    assert result.edits or result.decision == "match"


def test_nothing_is_said_of_what_nothing_is_wrong_with():
    for seed, noise_rad in enumerate((0.005, 0.03, 0.1, 0.2)):
        quality = Quality(noise_rad=noise_rad, clock_ppm=40.0)
        there = clip_of_pieces((0, 180), seed=seed, quality=quality)
        assert hints(verdict(there)) == []
        assert verdict(there).edits == verdict(there).segments == ()
        elsewhere = edited_clip([Piece(OTHER, 300.0 + 400 * seed, 180)], seed, quality)
        assert hints(verdict(elsewhere)) == []


def test_a_hole_is_no_join():
    track = clip_of_pieces((0, 200))
    enf, phase = track.enf_hz.copy(), track.phase_rad.copy()
    enf[80:100], phase[80:100] = np.nan, np.nan
    result = verdict(dataclasses.replace(track, enf_hz=enf, phase_rad=phase))
    assert result.decision == "match"
    assert result.warnings == ()


def test_parts_begin_and_end_where_they_do():
    track, _ = without_jumps(clip_of_pieces((0, 70), (300, 80), (900, 90), seed=5))
    clip = clip_phase(track)
    found = Parts(track, clip, [GRID], MatchSettings()).found(Place(0, BEGIN_S, 0.1, 0.0))
    lags = [part.place.lag_s - BEGIN_S for part in found]
    assert lags == pytest.approx([0, 230, 750], abs=0.5)
    ends_s = [clip.t_s[part.span[1] - 1] for part in found]
    assert ends_s == pytest.approx([70, 150, 240], abs=4)
    assert all(part.log10_lr >= 2 for part in found)


@pytest.mark.parametrize("steps_s", [(1.0, 2.0), (2.0, 1.0)])
def test_a_wrong_step_is_told_of_the_reference_that_has_it(steps_s):
    clip = clip_of_pieces((0, 200))
    references = {
        step_s: dataclasses.replace(reference_of(stretch, seed=1), step_s=step_s)
        for step_s, stretch in zip(sorted(steps_s), (OTHER, DAY), strict=True)
    }
    result = verdict(clip, *(references[step_s] for step_s in steps_s))
    assert result.decision == "no_decision"
    assert "with a step of 1 s instead of 2 s the reference would fit, 3000.4 s" in said(result)
