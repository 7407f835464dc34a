"""The store of cameras from the command line: what is kept, who is identified, what is refused."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.cli import main

Done = subprocess.CompletedProcess[str]
Verb = Callable[..., Done]
RATIOS = (0.30, 0.30, 0.30, 0.42, 0.55)


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three clips of one camera, and one of each of two others."""
    folder = tmp_path_factory.mktemp("clips")
    paths = [folder / f"clip{seed}.npz" for seed in range(len(RATIOS))]
    for seed, (path, ratio) in enumerate(zip(paths, RATIOS, strict=True)):
        words = ("--out", path, "--duration-s", 20, "--size", "64x120", "--seed", seed)
        assert main(["simulate", *map(str, words), "--idle-ratio", str(ratio)]) == 0
    return paths


@pytest.fixture
def verb(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Verb:
    """Call ``rsenf camera``, in this process, with a store of the test's own."""
    monkeypatch.setenv("RSENF_STORE", str(tmp_path / "store"))

    def call(*words: object) -> Done:
        capsys.readouterr()
        code = main(["camera", *map(str, words)])
        return subprocess.CompletedProcess(words, code, *capsys.readouterr())

    return call


def told(verb: Verb, *words: object) -> dict[str, Any]:
    done = verb(*words, "--json")
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_the_camera_that_took_it_is_first(verb: Verb, clips: list[Path]) -> None:
    assert verb("add", "Anna's phone", clips[0], clips[1]).returncode == 0
    known = told(verb, "add", "dashcam", clips[3])["cameras"]
    assert [(k["name"], len(k["recordings"])) for k in known] == [
        ("Anna's phone", 2),
        ("dashcam", 1),
    ]
    assert known[0]["lines"] == 120
    found = told(verb, "identify", clips[2])
    assert found["verdict"] == "compatible"
    first, second = found["cameras"]
    assert (first["name"], first["verdict"]) == ("Anna's phone", "compatible")
    assert (second["name"], second["verdict"]) == ("dashcam", "different")
    assert first["verbal"] == "moderate support for this camera"
    assert 1.0 < found["log10_odds"] < first["log10_lr"] < 2.0
    assert any("don't prove one camera" in line for line in found["caveats"])
    assert "no survey" in found["prior"]


def test_an_unknown_camera_is_nobody(verb: Verb, clips: list[Path]) -> None:
    verb("add", "phone", clips[0])
    verb("add", "dashcam", clips[3])
    done = verb("identify", clips[4])
    assert done.returncode == 0
    assert done.stdout.startswith("different: none of the 2 known")
    assert "against this camera" in done.stdout


def test_a_recording_of_the_store_is_not_its_own_witness(verb: Verb, clips: list[Path]) -> None:
    verb("add", "phone", clips[0])
    alone = told(verb, "identify", clips[0])
    assert (alone["verdict"], alone["cameras"]) == ("undecidable", [])
    verb("add", "phone", clips[1])
    found = told(verb, "identify", clips[0])
    assert found["cameras"][0]["recordings"] == [str(clips[1])]
    assert any("own recordings" in line for line in found["caveats"])


def test_a_file_is_known_once(verb: Verb, clips: list[Path]) -> None:
    verb("add", "phone", clips[0])
    (known,) = told(verb, "add", "phone", clips[0], "--clock-ppm", -7.5)["cameras"]
    assert len(known["recordings"]) == 1
    assert known["clock_ppm"] == -7.5
    done = verb("add", "dashcam", clips[0])
    assert done.returncode == 2
    assert f"{clips[0]} is phone's in the store" in done.stderr


def test_a_crop_is_a_mode(verb: Verb, clips: list[Path]) -> None:
    verb("add", "phone", clips[0], "--crop", "full")
    known = told(verb, "add", "phone", clips[3], "--crop", "stabilised")["cameras"]
    assert [k["crop"] for k in known] == ["full", "stabilised"]
    assert len(told(verb, "identify", clips[1])["cameras"]) == 2
    (only,) = told(verb, "identify", clips[1], "--crop", "full")["cameras"]
    assert only["crop"] == "full"


def test_another_mode_tells_nothing(verb: Verb, clips: list[Path], tmp_path: Path) -> None:
    other = tmp_path / "other.npz"
    words = ("--out", other, "--duration-s", 20, "--size", "64x96", "--seed", 9)
    assert main(["simulate", *map(str, words), "--idle-ratio", "0.3"]) == 0
    verb("add", "phone", clips[0])
    done = verb("identify", other)
    assert done.stdout.startswith("undecidable: no camera is known in this recording's mode")


def test_without_a_read_out_time_nothing_is_added(
    verb: Verb, clips: list[Path], tmp_path: Path
) -> None:
    dark = tmp_path / "dark.npz"
    level = np.full((900, 60), 100.0, np.float32)
    np.savez(dark, rows=level, frame_time_s=np.arange(900) / 30.0)
    done = verb("add", "phone", clips[0], dark)
    assert (done.returncode, done.stdout) == (1, "")
    assert f"{dark} gives no read-out time: no mains flicker" in done.stderr
    assert told(verb, "list")["cameras"] == []
    found = told(verb, "identify", dark)
    assert (found["verdict"], found["mode"], found["log10_odds"]) == ("undecidable", None, None)
    assert found["reason"].startswith("no read-out time: no mains flicker")


def test_an_empty_store_says_how_to_fill_it(verb: Verb) -> None:
    done = verb("list")
    assert done.returncode == 0
    assert "rsenf camera add NAME FILE" in done.stdout


READING = {
    "recording": "a.mp4", "mode": {"frame_rate_hz": 30.0, "lines": 1080}, "direction": "",
    "read_out_time_s": 0.02, "read_out_time_std_s": 1e-4,
}  # fmt: skip


def damaged(**changed: object) -> str:
    return json.dumps({"version": 1, "cameras": {"phone": [READING | changed]}})


@pytest.mark.parametrize(
    "held",
    [
        "{", '{"version": 2, "cameras": {}}', "[]", '{"version": 1}', "[" * 100_000,
        damaged(read_out_time_std_s=0.0), damaged(read_out_time_s=10**400),
        damaged(clock_ppm=float("nan")), damaged(direction=[]), damaged(more=1),
    ],
)  # fmt: skip
def test_what_is_no_store_is_left_alone(
    verb: Verb, clips: list[Path], tmp_path: Path, held: str
) -> None:
    path = tmp_path / "store" / "cameras.json"
    path.parent.mkdir()
    path.write_text(held)
    done = verb("add", "phone", clips[0])
    assert done.returncode == 1
    assert "is no store of cameras" in done.stderr
    assert path.read_text() == held


@pytest.mark.parametrize("share", ["1", "-0.1", "nan"])
def test_a_share_that_is_none(verb: Verb, clips: list[Path], share: str) -> None:
    done = verb("identify", clips[0], "--same-model", share)
    assert done.returncode == 2
    assert "from 0 to below 1" in done.stderr


def test_a_camera_turned_over_is_said(verb: Verb, clips: list[Path], tmp_path: Path) -> None:
    turned = tmp_path / "turned.npz"
    with np.load(clips[1]) as held:
        np.savez(turned, rows=held["rows"][:, ::-1], frame_time_s=held["frame_time_s"])
    verb("add", "phone", clips[0])
    found = told(verb, "identify", turned)
    assert found["verdict"] == "compatible"
    assert any("turned over" in line for line in found["caveats"])
    assert not any("turned over" in line for line in told(verb, "identify", clips[1])["caveats"])


def test_a_video_tells_its_whole_size(verb: Verb, clip: Path) -> None:
    (known,) = told(verb, "add", "phone", clip)["cameras"]
    height, width = known["lines"], known["across_px"]
    assert (width, height) == (320, 240)
    assert f"{height} lines of {width} pixels" in verb("list").stdout
