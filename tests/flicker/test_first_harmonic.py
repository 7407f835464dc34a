"""What is followed is the light's first harmonic, and not the image of its second."""

from __future__ import annotations

import pytest

from rsenf.flicker.mains import SECOND
from tests.discrepancy.foreign_camera import trial
from tests.flicker.foreign_rows import follow

KIND = "second harmonic, moving object"


@pytest.mark.parametrize(("seed", "grid"), [(33157, "rough"), (31057, "continental")])
def test_at_60_frames_the_image_of_200_hz_is_refused(seed: int, grid: str) -> None:
    clip = follow(trial(KIND, seed, rate="60.02", nominal_hz=50.0, grid=grid))
    assert not clip.off_hz.size
    assert SECOND in {second.reason for second in clip.seconds}


@pytest.mark.parametrize("kind", ["cfl", "key dimming", "second harmonic, gamma"])
def test_the_first_harmonic_is_not(kind: str) -> None:
    clip = follow(trial(kind, 33256, rate="60.02", nominal_hz=50.0, grid="rough"))
    assert clip.off_hz.size > 50
    assert clip.rms_z < 2.0
