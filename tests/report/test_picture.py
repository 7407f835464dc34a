"""The picture is a real PNG, whatever there is to draw, and appears whole or not at all."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from rsenf.errors import RecordingError
from rsenf.messages import Header, MatchResult
from rsenf.report import panels
from rsenf.report.picture import ThinRows, draw
from rsenf.report.recording_time import Basis
from tests.report.filmed import RATE_HZ, analysed, grid_hz, lit, reference
from tests.report.report_cases import FREQ_HZ, T0_NS, found_case


def colours(path: Path) -> np.ndarray:
    image = cv2.imread(str(path))
    assert image is not None, "not a picture"
    assert image.shape == (1100, 1100, 3)
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    assert 20_000 < path.stat().st_size < 1_000_000
    return np.asarray(image.reshape(-1, 3)[:, ::-1], np.int64)


def has(image: np.ndarray, colour: str) -> bool:
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return bool((abs(image - wanted).max(axis=1) <= 2).sum() > 20)


@pytest.fixture(scope="module")
def found() -> Basis:
    return found_case()


def draw_case(path: Path, case: Basis) -> None:
    draw(path, case.spectrum, case.estimates, reference(FREQ_HZ, T0_NS), case.result)


def test_a_match(tmp_path: Path, found: Basis) -> None:
    assert found.result.decision == "match"
    draw_case(tmp_path / "x.png", found)
    assert [p.name for p in tmp_path.iterdir()] == ["x.png"]
    image = colours(tmp_path / "x.png")
    assert has(image, panels.SIGNAL)
    assert has(image, panels.MARK)


def test_a_person_s_own_settings_change_nothing(tmp_path: Path, found: Basis) -> None:
    draw_case(tmp_path / "plain.png", found)
    with matplotlib.rc_context({"axes.facecolor": "yellow", "font.size": 20, "lines.linewidth": 9}):
        draw_case(tmp_path / "own.png", found)
        assert matplotlib.rcParams["font.size"] == 20
    plain, own = (cv2.imread(str(tmp_path / name)) for name in ("plain.png", "own.png"))
    assert np.array_equal(plain, own)


def test_frame_means_and_a_reference_with_gaps(tmp_path: Path) -> None:
    freq_hz = grid_hz(1500)
    gappy = freq_hz.copy()
    gappy[730:745] = np.nan
    level = lit(freq_hz, 700, 90, rows=1)
    blocks = reference(gappy, 0)
    rows, estimates, result = analysed(level, blocks)
    assert rows.kept_rows == 1
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert has(colours(tmp_path / "x.png"), panels.SIGNAL)


@pytest.mark.parametrize("seconds", [0.1, 5, 25])
def test_little_to_draw(tmp_path: Path, seconds: float) -> None:
    freq_hz = grid_hz(100)
    blocks = reference(freq_hz, 0)
    rows, estimates, result = analysed(lit(freq_hz, 10, 60)[: int(seconds * RATE_HZ)], blocks)
    assert result.decision == "no_decision"
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert has(colours(tmp_path / "x.png"), panels.SIGNAL) is any(e.usable for e in estimates)


def test_darkness(tmp_path: Path) -> None:
    blocks = reference(grid_hz(100), 0)
    rows, estimates, result = analysed(np.full((1200, 8, 1), 16.0, np.float32), blocks)
    assert result.reason.startswith("no usable signal")
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert not has(colours(tmp_path / "x.png"), panels.SIGNAL)


def test_no_rows_at_all(tmp_path: Path) -> None:
    draw(tmp_path / "x.png", ThinRows(), [], [], MatchResult(header=Header(), reason="nothing"))
    colours(tmp_path / "x.png")


def test_a_long_reason_is_broken_into_lines(tmp_path: Path) -> None:
    result = MatchResult(header=Header(), reason="and so on " * 30)
    draw(tmp_path / "x.png", ThinRows(), [], [], result)
    colours(tmp_path / "x.png")


def test_a_picture_that_can_t_be_written(tmp_path: Path) -> None:
    result = MatchResult(header=Header(), reason="nothing")
    with pytest.raises(RecordingError, match="can't write"):
        draw(tmp_path / "no" / "x.png", ThinRows(), [], [], result)


def test_a_picture_that_is_interrupted_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: Figure, path: Path, **__: object) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(Figure, "savefig", interrupted)
    (tmp_path / "x.png").write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt):
        draw(tmp_path / "x.png", ThinRows(), [], [], MatchResult(header=Header()))
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("x.png", b"old")]
