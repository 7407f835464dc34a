"""A film in another shape, in a container that rounds its stamps."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import DATA
from tests.real.edited import Edited, Light, words_of


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="FFmpeg's program isn't installed")
@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA}")
@pytest.mark.parametrize(
    ("rate", "edit", "container"), [("30", "letterbox", "mkv"), ("60000/1001", "pillarbox", "mov")]
)
def test_bars_and_rounded_stamps(tmp_path: Path, rate: str, edit: str, container: str) -> None:
    film = Edited(
        seed=7, rate=rate, nominal_hz=50.0, seconds=40.0, edit=edit, coder="mjpeg",
        container=container, idle_ratio=0.2, exposure_s=5e-4, flicker_ratio=0.02,
        second_ratio=0.3, moves=False,
    )  # fmt: skip
    told = film.line(Light(50.0, film.seconds, np.random.default_rng(7)), tmp_path)
    assert told["usable"] > 0.9
    assert told["rms_z"] < 2.0
    assert abs(told["idle_off"]) < 5.0 * told["idle_std"] < 0.02
    assert f"7 {edit}, mjpeg, {container}, {rate}, 50 Hz, 2 %, full: " in words_of(told)


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="FFmpeg's program isn't installed")
@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA}")
def test_a_film_from_the_hand_is_nearly_as_good_as_one_at_rest(tmp_path: Path) -> None:
    rested, moved = (
        Edited(
            seed=8, rate="24", nominal_hz=50.0, seconds=40.0, edit="none", coder="x264 1500k",
            container="mp4", idle_ratio=0.2, exposure_s=5e-4, flicker_ratio=0.02,
            second_ratio=0.3, moves=moves,
        ).line(Light(50.0, 40.0, np.random.default_rng(8)), tmp_path)
        for moves in (False, True)
    )  # fmt: skip
    assert moved["usable"] > 0.9
    assert moved["rms_z"] < 2.0
    assert moved["rms_hz"] < 2.0 * rested["rms_hz"]
    assert abs(moved["idle_off"]) < 5.0 * moved["idle_std"] < 0.01
