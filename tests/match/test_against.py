"""Two recordings against each other: made together, and how far apart, or not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rsenf.errors import UsageError
from rsenf.match.against import align, match_against
from rsenf.match.settings import MatchSettings
from tests.match.match_clips import clip_of
from tests.match.phase_clips import hidden, stretch_of

DAY = stretch_of(4_000, seed=31)
SETTINGS = MatchSettings()


def recorded(start_s, seed, **properties):
    return hidden(DAY, seed, start_s=start_s, **properties)[0]


@pytest.mark.parametrize(("lead_s", "lengths"), [(31.4, (150, 240)), (-40.7, (240, 150))])
def test_offset_and_difference_of_clocks_come_back(lead_s, lengths):
    first = recorded(1000.0 + lead_s, 1, seconds=lengths[0], clock_ppm=30.0)
    second = recorded(1000.0, 2, seconds=lengths[1], clock_ppm=-15.0)
    found = match_against(first, second, SETTINGS)
    assert found.decision == "match"
    assert found.offset_s == pytest.approx(lead_s, abs=4 * found.offset_std_s)
    assert found.offset_std_s < 0.3
    assert found.clock_ppm == pytest.approx(45.0, abs=4 * found.clock_std_ppm)
    assert found.log10_lr >= 2


def test_the_other_way_round_is_the_same_with_other_signs():
    first, second = recorded(1020.0, 3, seconds=150), recorded(1000.0, 4, seconds=240)
    here, there = match_against(first, second, SETTINGS), match_against(second, first, SETTINGS)
    assert here.offset_s == -there.offset_s
    assert here.clock_ppm == -there.clock_ppm
    assert here.log10_lr == there.log10_lr


def test_recordings_of_different_times_do_not_fit():
    for seed in range(3):
        first = recorded(300.0 + 700 * seed, 10 + seed, seconds=150)
        second = recorded(700.0 + 700 * seed, 20 + seed, seconds=240)
        found = match_against(first, second, SETTINGS)
        assert found.decision == "no_match"
        assert found.log10_lr < -1


def test_recordings_on_different_grids_were_not_made_together():
    other = hidden(stretch_of(2000, seed=32, nominal_hz=60.0), 5, start_s=300.0)[0]
    found = match_against(recorded(1000.0, 6), other, SETTINGS)
    assert (found.decision, found.reason[:4]) == ("no_match", "one ")


def test_a_recording_without_signal_decides_nothing():
    silent = recorded(1000.0, 7)
    silent = dataclasses.replace(silent, enf_hz=silent.enf_hz + float("nan"))
    found = match_against(recorded(1000.0, 8), silent, SETTINGS)
    assert (found.decision, found.reason) == ("no_decision", "no usable signal")


def test_estimates_that_overlap_are_refused():
    with pytest.raises(UsageError, match="no phase"):
        match_against(recorded(1000.0, 9), clip_of(DAY.freq_hz, 1000.5, 200, 1), SETTINGS)


def test_several_are_placed_on_the_first_ones_time():
    begins = (1000.0, 1031.4, 980.3)
    tracks = [
        recorded(begin_s, 40 + k, seconds=200, clock_ppm=20.0 * k)
        for k, begin_s in enumerate(begins)
    ]
    other = hidden(stretch_of(2000, seed=32), 5, start_s=300.0)[0]
    found = align([*tracks, other], SETTINGS)
    for k in (1, 2):
        assert found.begin_s[k] == pytest.approx(begins[k] - 1000.0, abs=4 * found.begin_std_s[k])
        assert found.clock_ppm[k] == pytest.approx(20.0 * k, abs=4 * found.clock_std_ppm[k])
        assert found.begin_std_s[k] < 0.3
    assert found.misfit < 3.0
    assert not np.isfinite(found.begin_s[3])
    assert set(found.pairs) == {(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)}


def test_a_recording_is_placed_by_another_than_the_first():
    first, second = recorded(1000.0, 50, seconds=120), recorded(1080.0, 51, seconds=240)
    third = recorded(1250.0, 52, seconds=120)
    found = align([first, second, third], SETTINGS)
    assert found.pairs[0, 2].decision != "match"
    assert found.begin_s[2] == pytest.approx(250.0, abs=4 * found.begin_std_s[2])
    assert np.isnan(found.misfit)
