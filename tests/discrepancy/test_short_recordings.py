"""Recordings of some 8 s, the longest real ones with rows among them."""

from __future__ import annotations

from pathlib import Path

import pytest

import rsenf
from tests.discrepancy.foreign_camera import Case, film


@pytest.mark.measured
def test_gain_steps_of_a_real_sensor_are_named(measured_data: Path) -> None:
    found = rsenf.discover(measured_data / "real_rows" / "pi_scanny_30.npz")
    assert [effect["name"] for effect in found.effects] == ["auto_exposure"]
    assert found.effects[0]["gap_after"] < found.effects[0]["gap_before"] / 10.0
    # A codec's losses and a scene that shades itself are left, and said to be.
    assert found.verdict == "unexplained"
    assert found.unexplained["places"]


@pytest.mark.parametrize("seed", [71, 72, 73])
@pytest.mark.parametrize("hidden", [(), ("reverse_readout",), ("gop_attenuation",)])
def test_what_a_foreign_camera_hides_in_eight_seconds_is_found(
    hidden: tuple[str, ...], seed: int
) -> None:
    made = film(Case(hidden=hidden, seed=seed, duration_s=8.2))
    found = rsenf.discover(made.level, frame_time_s=made.stamp_s)
    assert {effect["name"] for effect in found.effects} - {"harmonics"} == set(hidden)
