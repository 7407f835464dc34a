"""Effects that FFmpeg has hidden are found by the command; all there are: see by_ffmpeg.py."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.discrepancy.by_ffmpeg import CASES, discovered, film, grade, made

SECONDS = 25.0
pytestmark = [
    pytest.mark.external,
    pytest.mark.skipif(not shutil.which("ffmpeg"), reason="needs ffmpeg"),
]


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return film(tmp_path_factory.mktemp("clean") / "clean.mp4", 77, seconds=SECONDS)


@pytest.mark.parametrize("name", ["hflip", "crop rows", "duplicate", "interlace", "fade in"])
def test_it_is_found_as_it_should(name: str, clean: Path, tmp_path: Path) -> None:
    case = CASES[name]
    told = discovered(made(clean, tmp_path / "clip.mp4", case), tmp_path / "found")
    assert grade(case, told) == "right"
    if told["verdict"] == "explained":
        assert told["gap"]["shrinkage"] > 0.9
    if not told["effects"]:
        assert told["idle_ratio"] == pytest.approx(case.idle_ratio, abs=1e-3)


def test_what_an_encoder_does_by_itself_is_no_effect(clean: Path, tmp_path: Path) -> None:
    case = CASES["50k weighted"]
    told = discovered(made(clean, tmp_path / "clip.mp4", case), tmp_path / "found")
    assert grade(case, told) == "right"
    assert told["gap"]["codec"] > 1e-4
    assert told["idle_ratio"] == pytest.approx(case.idle_ratio, abs=5e-3)
