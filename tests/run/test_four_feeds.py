"""The feeds of the study by hand turn bad as they should."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.run.feed_server import Film, shown


@pytest.fixture
def film(tmp_path: Path) -> Film:
    path = tmp_path / "film.h264"
    path.write_bytes(bytes(range(100)))
    about = {"begins": list(range(100)), "gop_frames": 5, "period_s": 0.1}
    path.with_suffix(".json").write_text(json.dumps(about), encoding="utf-8")
    return Film(path)


@pytest.mark.parametrize(
    ("mode", "pictures"),
    [
        ("live", [38, 39, 40, 41, 49, 50, 51, 60]),
        ("loop", [38, 39, 30, 31, 39, 30, 31, 30]),
        ("frozen", [38, 39, 35, 35, 35, 35, 35, 35]),
    ],
)
def test_a_feed_turns_bad_at_a_key_picture(film: Film, mode: str, pictures: list[int]) -> None:
    number = shown(film, mode, after_s=4.2, loop_s=1.1)
    assert [number(n) for n in (38, 39, 40, 41, 49, 50, 51, 60)] == pictures
    assert film.picture(number(40)) == bytes([pictures[2]])
    assert len(film) == 100
