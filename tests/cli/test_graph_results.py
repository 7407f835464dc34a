"""What comes of a graph of processes is what one process says, and the demo shows it."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]
pytestmark = pytest.mark.processes


def test_track_says_the_same_of_a_recording_and_of_its_video(
    rsenf: Rsenf, clip: Path, recording: Path
) -> None:
    of_video, of_rows = (rsenf("track", path, "--json") for path in (clip, recording))
    assert (of_video.returncode, of_rows.returncode) == (0, 0)
    assert len(of_video.stdout.splitlines()) >= 26
    assert of_rows.stdout == of_video.stdout
    assert of_rows.stderr == of_video.stderr


def test_verify_takes_a_recording(
    rsenf: Rsenf, clip: Path, recording: Path, hidden: HiddenClip, tmp_path: Path
) -> None:
    reference = hidden.reference
    of_video, of_rows = (
        rsenf("verify", path, "--reference", reference, "--json", "--picture", tmp_path / "x.png")
        for path in (clip, recording)
    )
    assert of_rows.stdout == of_video.stdout
    assert (tmp_path / "x.png").stat().st_size > 20_000


@pytest.fixture(scope="module")
def demo(rsenf: Rsenf, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """Folder (with a space in its name), stdout and stderr of the demo."""
    out = tmp_path_factory.mktemp("demo") / "my demo"
    done = rsenf("demo", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    return out, done.stdout, done.stderr


def test_the_demo_s_keys(demo: tuple[Path, str, str]) -> None:
    out, stdout, _ = demo
    summary = json.loads(stdout)
    names = {"clip.mp4", "clip.truth.json", "reference.csv", "graph.yaml", "recording.mcap",
             "picture.png"}  # fmt: skip
    assert {p.name for p in out.iterdir()} == names
    files = ("clip", "truth", "reference", "graph", "recording", "picture")
    assert {summary[name] for name in files} == {str(out / name) for name in names}
    assert summary["right"] is True
    assert summary["verdict"]["decision"] == "match"
    assert abs(summary["lag_error_s"]) < 1.0
    assert abs(summary["verdict"]["lag_s"] - summary["true_lag_s"]) < 1.0
    assert summary["usable"] == summary["estimates"] >= 71
    assert 0.0 < summary["enf_error_rms_mhz"] <= summary["enf_error_max_mhz"]
    assert summary["enf_error_rms_mhz"] < 5.0


def test_the_demo_s_picture(demo: tuple[Path, str, str]) -> None:
    image = cv2.imread(str(demo[0] / "picture.png"))
    assert image is not None
    assert image.shape == (1100, 1100, 3)


def test_the_demo_says_what_it_does_on_stderr(demo: tuple[Path, str, str]) -> None:
    steps = [line for line in demo[2].splitlines() if line.startswith("rsenf: ")]
    assert [line[:11] for line in steps] == ["rsenf: 1/3 ", "rsenf: 2/3 ", "rsenf: 3/3 "]


def test_the_demo_s_files_are_of_use_from_any_folder(
    rsenf: Rsenf, demo: tuple[Path, str, str], tmp_path: Path
) -> None:
    out = demo[0]
    again = rsenf("run", out / "graph.yaml", "--quiet", "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    (result,) = json.loads(again.stdout)["results"].values()
    assert result == json.loads(demo[1])["verdict"]
    one = rsenf(
        "verify", out / "clip.mp4", "--reference", out / "reference.csv", "--json", cwd=tmp_path
    )
    in_one_process = json.loads(one.stdout)
    for verdict in (result, in_one_process):
        # A graph names its reference; a file that is given has its own name.
        for named in (verdict, *verdict["candidates"]):
            del named["grid"]
    assert in_one_process.pop("case") is None  # which a graph has none of
    assert in_one_process == result


@pytest.mark.parametrize("seconds", ["30", "4000"])
def test_a_demo_of_another_length(rsenf: Rsenf, seconds: str, tmp_path: Path) -> None:
    done = rsenf("demo", "--out", tmp_path / "x", "--duration-s", seconds)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"rsenf: --duration-s {seconds} suits no demo (60 to 3600)\n"
    assert not (tmp_path / "x").exists()
