"""The picture is a real PNG, whatever there is to draw, and appears whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from rsenf.errors import RecordingError
from rsenf.match import Match
from rsenf.messages import EnfEstimate, Header, MatchResult, ReferenceBlock
from rsenf.report import picture
from rsenf.report.picture import draw
from rsenf.report.spectrum import ThinRows
from rsenf.rows.luminance import blocks_from_luminance
from rsenf.track import TrackSettings, make_tracker

RATE_HZ = 30.0


def grid_hz(seconds: int) -> np.ndarray:
    rng = np.random.default_rng(4)
    return 50.0 + 0.1 * np.convolve(rng.normal(0, 1, seconds + 39), np.ones(40) / 40, "valid")


def reference(freq_hz: np.ndarray, t0_ns: int) -> list[ReferenceBlock]:
    count = freq_hz.size
    return [ReferenceBlock(
        header=Header(source="reference/test"), grid="test", nominal_hz=50.0, t0_ns=t0_ns,
        step_ns=10**9, first=0, samples=count, total=count, freq_hz=freq_hz,
        readings=np.isfinite(freq_hz).astype(np.uint32),
    )]  # fmt: skip


def analysed(
    level: np.ndarray, blocks: Sequence[ReferenceBlock]
) -> tuple[ThinRows, list[EnfEstimate], MatchResult]:
    rows, tracker, match = ThinRows(), make_tracker(TrackSettings(nominal_hz=50.0)), Match()
    for reference_block in blocks:
        match.update(reference_block)
    estimates = []
    time_s = np.arange(len(level)) / RATE_HZ
    for block in blocks_from_luminance(level, time_s, Header(source="test/cam1")):
        rows.add(block)
        estimates += tracker.update(block)
    estimates += tracker.flush()
    for estimate in estimates:
        match.update(estimate)
    (result,) = match.flush()
    return rows, estimates, result


def lit(freq_hz: np.ndarray, begin: int, seconds: int, rows: int = 32) -> np.ndarray:
    """Rows filmed in the light of a grid, from one of its seconds on."""
    phase = 4 * np.pi * np.concatenate([[0.0], np.cumsum(freq_hz)])
    frame_s = begin + np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    at_s = frame_s[:, None] + np.arange(rows) * 0.6 / RATE_HZ / rows
    wave = np.cos(np.interp(at_s, np.arange(phase.size), phase))
    return (100.0 + 5.0 * wave)[:, :, None].astype(np.float32)


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


def test_a_match(tmp_path: Path) -> None:
    freq_hz = grid_hz(1500)
    blocks = reference(freq_hz, 1_700_000_000 * 10**9)
    rows, estimates, result = analysed(lit(freq_hz, 700, 180), blocks)
    assert result.decision == "match"
    assert result.lag_s == pytest.approx(700, abs=1)
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert [p.name for p in tmp_path.iterdir()] == ["x.png"]
    image = colours(tmp_path / "x.png")
    assert has(image, picture.SIGNAL)
    assert has(image, picture.MARK)


def test_frame_means_and_a_reference_with_gaps(tmp_path: Path) -> None:
    freq_hz = grid_hz(1500)
    gappy = freq_hz.copy()
    gappy[730:745] = np.nan
    level = lit(freq_hz, 700, 90, rows=1)
    blocks = reference(gappy, 0)
    rows, estimates, result = analysed(level, blocks)
    assert rows.kept_rows == 1
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert has(colours(tmp_path / "x.png"), picture.SIGNAL)


@pytest.mark.parametrize("seconds", [0.1, 5, 25])
def test_little_to_draw(tmp_path: Path, seconds: float) -> None:
    freq_hz = grid_hz(100)
    blocks = reference(freq_hz, 0)
    rows, estimates, result = analysed(lit(freq_hz, 10, 60)[: int(seconds * RATE_HZ)], blocks)
    assert result.decision == "no_decision"
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert has(colours(tmp_path / "x.png"), picture.SIGNAL) is any(e.usable for e in estimates)


def test_darkness(tmp_path: Path) -> None:
    blocks = reference(grid_hz(100), 0)
    rows, estimates, result = analysed(np.full((1200, 8, 1), 16.0, np.float32), blocks)
    assert result.reason == "no usable signal"
    draw(tmp_path / "x.png", rows, estimates, blocks, result)
    assert not has(colours(tmp_path / "x.png"), picture.SIGNAL)


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
