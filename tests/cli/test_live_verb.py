"""What ``rsenf live`` says of a recording: as it came, late, and without a time to go by."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.cli import main, verb_parser
from rsenf.cli.track import _settings
from rsenf.errors import EXIT_DONE, EXIT_USAGE
from rsenf.model import CaptureModel, GridPath, Shutter, simulate_rows, synthetic_grid

BEGIN = datetime(2026, 1, 2, 3, 4, tzinfo=UTC)
START_S = 200.0


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A clip's luminance, and the reference of its grid."""
    folder = tmp_path_factory.mktemp("live")
    freq = np.diff(synthetic_grid(5, 402.0).cycles(np.arange(401.0)))
    model = CaptureModel(shutter=Shutter(rows=32, columns=64, idle_ratio=0.3))
    made = simulate_rows(model, GridPath(freq, 1.0, START_S), 75.0, 1)
    clip, grid = folder / "clip.npz", folder / "grid.csv"
    np.savez(clip, rows=made.level[:, :, 0], frame_time_s=made.frame_time_s)
    moments = [(BEGIN + timedelta(seconds=k)).isoformat() for k in range(freq.size)]
    lines = [f"{moment},{hz:.6f}" for moment, hz in zip(moments, freq, strict=True)]
    grid.write_text("\n".join(["time,frequency", *lines]), encoding="utf-8")
    return str(clip), str(grid)


def judged(files: tuple[str, str], late_s: float, capsys: pytest.CaptureFixture[str]) -> Any:
    start = BEGIN + timedelta(seconds=START_S + late_s)
    words = ["live", files[0], "--reference", files[1], "--start", start.isoformat(), "--json"]
    assert main(words) == EXIT_DONE
    return json.loads(capsys.readouterr().out)


def test_as_it_came_it_is_live(files: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    told = judged(files, 0.5, capsys)
    assert [v["verdict"] for v in told["verdicts"]] == ["undecided", "live"]
    assert told["verdict"] == told["last"]["verdict"] == "live"
    assert told["last"]["lag_s"] == pytest.approx(0.5, abs=0.5)
    assert told["alarms"] == []


def test_shown_later_it_is_stale_and_from_when_is_told(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    told = judged(files, 100.0, capsys)
    assert told["verdict"] == "stale"
    assert told["last"]["lag_s"] == pytest.approx(100.0, abs=0.5)
    taken = datetime.fromisoformat(told["last"]["origin_utc"])
    expected = BEGIN + timedelta(seconds=START_S + told["last"]["t_s"])
    assert abs((taken - expected).total_seconds()) < 1.5
    assert [a["kind"] for a in told["alarms"]] == ["stale"]


@pytest.mark.parametrize(
    ("more", "hint"),
    [
        ([], "--start"),
        (["--start", "yesterday"], "not a time"),
        (["--start", "2026-01-02", "--step-s", "1"], "no times of day"),
        (["--start", "2026-01-02", "--reference-camera", "other"], "not allowed with"),
    ],
)
def test_what_does_not_tell_the_time_is_refused_in_one_line(
    files: tuple[str, str], more: list[str], hint: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    grid = files[1]
    if "--step-s" in more:
        grid = str(tmp_path / "timeless.csv")
        Path(grid).write_text("frequency\n" + "50.01\n" * 100, encoding="utf-8")
    try:
        code = main(["live", files[0], "--reference", grid, *more])
    except SystemExit as exc:
        code = int(exc.code or 0)
    assert code == EXIT_USAGE
    said = capsys.readouterr().err.splitlines()
    assert len([line for line in said if line.startswith("rsenf")]) == 1
    assert hint in said[-1]


def test_another_camera_is_only_in_a_recording(
    files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["live", files[0], "--reference-camera", "other", "--start", "2026-01-02"]
    assert main(words) == EXIT_USAGE
    assert "has no other camera" in capsys.readouterr().err


def test_a_cameras_pictures_are_decoded_as_asked() -> None:
    words = ["rtsp://127.0.0.1:9/1", "--reference", "grid.csv"]
    for effort in ("full", "fast"):
        args = verb_parser("live").parse_args([*words, "--effort", effort])
        assert _settings(args)["decode"]["effort"] == effort


@pytest.mark.parametrize("verb", [["track"], ["live", "--reference", "grid.csv"]])
@pytest.mark.parametrize("of_recordings", [["--camera", "door"], ["--from", "frames"]])
def test_what_chooses_within_a_recording_is_refused_for_a_camera(
    verb: list[str], of_recordings: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*verb, *of_recordings, "rtsp://127.0.0.1:9/1"]) == EXIT_USAGE
    (said,) = capsys.readouterr().err.splitlines()
    assert f"{of_recordings[0]} is for recordings" in said
