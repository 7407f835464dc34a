"""References: the time is in one of them, and in neither of the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rsenf.bench.recording_time import PlannedFilm
from rsenf.bench.recording_time.trials import (
    OTHER_FROM_NS,
    _lit_day,
    _other_day,
    references_of,
)
from rsenf.bench.scenes import REFERENCE_NOISE_HZ
from rsenf.reference import Reference

FILM = PlannedFilm("still", 0, "led", 4, reference_s=7200.0)
BEGIN_S, END_S = 3000.25, 3060.25


def searched(begin_s: float = BEGIN_S) -> dict[str, Reference]:
    return dict(references_of(FILM, begin_s, begin_s + END_S - BEGIN_S, None))


def test_present_is_the_day_with_noise_of_its_own() -> None:
    errors = searched()["present"].freq_hz - _lit_day(None).freq_hz[:7200]
    assert np.std(errors) == pytest.approx(REFERENCE_NOISE_HZ, rel=0.05)
    assert np.abs(np.corrcoef(errors[1:], errors[:-1])[0, 1]) < 0.05


def test_values_are_rounded_as_published_ones_are() -> None:
    tenths = searched()["present"].freq_hz * 1e4
    assert np.allclose(tenths, np.round(tenths), atol=1e-5)
    assert np.array_equal(searched()["present"].freq_hz, searched()["present"].freq_hz)


def test_same_day_lacks_the_time_and_ten_minutes_about_it() -> None:
    gap = np.flatnonzero(np.isnan(searched()["same_day"].freq_hz))
    assert (gap[0], gap[-1]) == (2400, 3660)
    assert np.all(np.diff(gap) == 1)
    assert not searched()["same_day"].readings[gap].any()


def test_a_gap_may_reach_over_the_days_end() -> None:
    assert np.isnan(searched(10.0)["same_day"].freq_hz[:670]).all()
    assert np.isnan(searched(7100.0)["same_day"].freq_hz[6500:]).all()


def test_noise_is_the_pieces_own_and_the_same_again() -> None:
    here, again, there = searched(), searched(), searched(BEGIN_S + 60)
    for trial, reference in here.items():
        assert np.array_equal(reference.freq_hz, again[trial].freq_hz, equal_nan=True)
        assert not np.array_equal(reference.freq_hz, there[trial].freq_hz, equal_nan=True)


def test_another_day_is_another_day() -> None:
    here, there = _lit_day(None).freq_hz, _other_day(None).freq_hz
    assert here.size == there.size == 86400
    assert abs(np.corrcoef(here, there)[0, 1]) < 0.2


@pytest.mark.measured
def test_measured_other_day_is_after_calibrations_and_has_few_gaps(measured_data: Path) -> None:
    other = _other_day(measured_data)
    assert other.t0_ns >= OTHER_FROM_NS
    assert other.freq_hz.size == 86400
    assert other.valid_samples > 0.98 * other.freq_hz.size
    assert _lit_day(measured_data).gaps == 0
