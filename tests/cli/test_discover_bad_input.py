"""What `rsenf discover` can make nothing of: one clear line, nothing that looks like a result."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsenf.api.discover import DiscoverResult, check_out
from rsenf.discrepancy.result import sha256_of
from rsenf.errors import UsageError
from rsenf.model import CaptureModel
from tests.cli.bad_files import USELESS, cut, grey_video

Rsenf = Callable[..., subprocess.CompletedProcess[str]]


def line_of(rsenf: Rsenf, path: Path) -> str:
    """The line by which it refuses a file, once nothing else is found to have been left."""
    done = rsenf("discover", path, "--out", path.parent / "found")
    assert (done.returncode, done.stdout) == (1, "")
    assert list(path.parent.iterdir()) == [path]
    *notes, line = done.stderr.splitlines()
    assert all(text.startswith("note: ") for text in notes), done.stderr
    assert line.startswith(f"rsenf: {path}")
    assert line.endswith(")"), f"no hint what to do: {line}"
    return line


def rows_file(path: Path, seconds: float = 30.0) -> Path:
    """Nothing but noise."""
    frames = int(30 * seconds)
    rows = np.random.default_rng(1).normal(100.0, 1.0, (frames, 48))
    np.savez(path, rows=rows, frame_time_s=np.arange(frames) / 30)
    return path


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("empty.mp4", "is empty"),
        ("text.mp4", "is not a video that can be read"),
        ("only_magic.mcap", "holds no row blocks"),
        ("flipped.npz", "is no .npz file that can be read"),
        ("nan.npz", "holds values that are not finite"),
    ],
)
def test_a_file_of_no_use(rsenf: Rsenf, name: str, says: str, tmp_path: Path) -> None:
    USELESS[name](tmp_path / name)
    assert says in line_of(rsenf, tmp_path / name)


def test_a_damaged_video(rsenf: Rsenf, tmp_path: Path, clip: Path) -> None:
    assert "moov" in line_of(rsenf, cut(clip, tmp_path / "cut.mp4", 0.5))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_one_value_that_is_not_finite(rsenf: Rsenf, value: float, tmp_path: Path) -> None:
    path = rows_file(tmp_path / "rows.npz")
    with np.load(path) as held:
        arrays = dict(held)
    arrays["rows"][400, 20] = value
    np.savez(path, **arrays)
    assert "holds values that are not finite" in line_of(rsenf, path)


def test_constant_light(rsenf: Rsenf, tmp_path: Path) -> None:
    assert "every frame is the same" in line_of(rsenf, grey_video(tmp_path / "grey.mp4", 900, 100))


@pytest.mark.parametrize("seconds", [0.3, 6.5])
def test_too_short(rsenf: Rsenf, seconds: float, tmp_path: Path) -> None:
    line = line_of(rsenf, rows_file(tmp_path / "brief.npz", seconds))
    assert "too short" in line
    assert "7 s are the least" in line


def test_nothing_but_noise(rsenf: Rsenf, tmp_path: Path) -> None:
    assert "no flicker to fit a model to" in line_of(rsenf, rows_file(tmp_path / "dark.npz"))


def test_an_earlier_result_is_left_as_it_was(rsenf: Rsenf, tmp_path: Path) -> None:
    found = tmp_path / "found"
    found.mkdir()
    (found / "discovery.json").write_text("{}")
    path = rows_file(tmp_path / "brief.npz", 5.0)
    assert rsenf("discover", path, "--out", found).returncode == 1
    assert [(p.name, p.read_text()) for p in found.iterdir()] == [("discovery.json", "{}")]


def test_an_effect_file_that_was_edited_is_not_replaced(tmp_path: Path) -> None:
    found = tmp_path / "found"
    result = DiscoverResult(
        recording="clip", verdict="explained", effects=[], gap={}, unexplained=None,
        document={"files": {"effect_tone.py": sha256_of("as written\n")}}, model=CaptureModel(),
        page="", residuals={}, files={"effect_tone.py": "as written\n"},
    )  # fmt: skip
    result.write(found)
    check_out(found)
    result.write(found)
    (found / "effect_mine.py").write_text("mine\n")
    with pytest.raises(UsageError, match=r"effect_mine\.py is of no earlier result"):
        check_out(found)
    (found / "effect_mine.py").unlink()
    (found / "effect_tone.py").write_text("checked, and named\n")
    for refused in (check_out, result.write):
        with pytest.raises(UsageError, match=r"effect_tone\.py is of no earlier result, or was"):
            refused(found)
    assert (found / "effect_tone.py").read_text() == "checked, and named\n"
    (found / "discovery.json").write_text("{}")
    with pytest.raises(UsageError, match="or was edited"):
        check_out(found)
