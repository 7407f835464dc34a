"""Light that stands still and isn't what it looks like: fields half a period apart, half-waves."""

from __future__ import annotations

import pytest

from rsenf.flicker.near_dc import FIELDS, HALF
from tests.discrepancy.foreign_camera.trials import trial
from tests.flicker.foreign_rows import follow


@pytest.mark.parametrize(
    ("kind", "rate", "nominal_hz", "seed", "reason"),
    [
        ("interlaced", "24", 60.0, 9874, FIELDS),  # by its second harmonic 23 mHz off
        ("half-wave part", "25", 50.0, 20510, HALF),
        ("half-wave part", "60", 60.0, 20507, HALF),
        ("second harmonic, moving object", "30.01", 60.0, 31007, HALF),  # taken for the first
    ],
)
def test_it_is_not_followed(
    kind: str, rate: str, nominal_hz: float, seed: int, reason: str
) -> None:
    made = follow(trial(kind, seed, rate=rate, nominal_hz=nominal_hz, grid="rough"))
    assert not made.off_hz.size
    assert made.seconds[-1].reason == reason


@pytest.mark.parametrize(
    ("kind", "rate", "nominal_hz", "seed"),
    [("cfl", "25", 50.0, 20509), ("led", "24", 60.0, 9875), ("interlaced", "25", 50.0, 9875)],
)
def test_other_light_that_stands_still_is(
    kind: str, rate: str, nominal_hz: float, seed: int
) -> None:
    made = follow(trial(kind, seed, rate=rate, nominal_hz=nominal_hz, grid="rough"))
    assert made.off_hz.size > 50
