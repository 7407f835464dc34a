"""Limits that hold for every method."""

from __future__ import annotations

import pytest

from rsenf.flicker.mains import is_second_harmonic
from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.moments import Moments, StillRows
from rsenf.idle.refusals import are_alike, checked

NTSC_HZ = 30000 / 1001


def seen(f0_hz: float, frame_rate_hz: float, nominal_hz: float = 50.0) -> EstimatorState:
    return EstimatorState(
        moments=Moments(100),
        still_rows=StillRows(0.0),
        nominal_hz=nominal_hz,
        f0_hz=f0_hz,
        frame_rate_hz=frame_rate_hz,
        unfiltered=False,
    )


def test_second_harmonic_mirrored_onto_the_first_is_told_by_its_deviation() -> None:
    # 200.02 Hz shows at -9.77 Hz from frame to frame, mirrored as 99.68 Hz would.
    assert is_second_harmonic(10 * NTSC_HZ - 200.02, 50.0, NTSC_HZ, -4.0)
    assert not is_second_harmonic(10 * NTSC_HZ - 200.02, 50.0, NTSC_HZ, 2.0)
    assert not is_second_harmonic(100.01, 50.0, NTSC_HZ, -2.0)
    assert not is_second_harmonic(99.9, 50.0, NTSC_HZ, -2.0)
    assert not is_second_harmonic(100.1, 50.0, 23.976, -2.0)


@pytest.mark.parametrize(
    ("frame_rate_hz", "alike"),
    [(20.0, True), (10.0, True), (27.5, True), (25.0, False), (NTSC_HZ, False), (60.0, False)],
)
def test_frame_rates_at_which_grids_look_alike(frame_rate_hz: float, alike: bool) -> None:
    assert are_alike(frame_rate_hz) is alike


def test_claims_are_checked() -> None:
    now = seen(100.0, 30.0)
    good = Finding.of_turns(2.0, 1e-4, 100.0)
    assert checked(now, good) is good
    assert "uncertain" in checked(now, Finding.of_turns(2.0, 0.1, 100.0)).reason
    assert "global" in checked(now, Finding.of_turns(0.01, 1e-6, 100.0)).reason
    # A short read-out is believed where the rows agree on it, as no codec's do.
    assert "copies rows" in checked(now, Finding.of_turns(0.3, 0.01**2, 100.0)).reason
    assert checked(now, Finding.of_turns(0.3, 0.001**2, 100.0)).verdict == "estimated"
    assert "longer" in checked(now, Finding.of_turns(3.6, 1e-6, 100.0)).reason
    assert checked(now, Finding.of_turns(3.34, 1e-3, 100.0)).verdict == "estimated"


def test_without_a_direction_the_frequency_may_be_on_either_side() -> None:
    found = Finding.of_turns(-2.0, 1e-6, 100.05).undirected(100.0)
    assert found.direction == ""
    assert found.turns == 2.0
    assert found.turns_var == pytest.approx(1e-6 + (2.0 * 0.05 / 100.0) ** 2)
    assert found.warnings
