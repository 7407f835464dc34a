"""What ``rsenf idle`` says of a recording, of two, and of those that it can say nothing of."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]
KEYS = {
    "verdict", "method", "idle_ratio", "idle_ratio_std", "idle_ratio_low", "idle_ratio_high",
    "read_out_time_s", "read_out_time_std_s", "direction", "frame_rate_hz", "nominal_hz",
    "converted", "slips", "reason", "rate_hypotheses", "warnings",
}  # fmt: skip


def estimate(rsenf: Rsenf, *words: object) -> dict[str, Any]:
    """The JSON of ``rsenf idle``, which has succeeded without a word on stderr."""
    done = rsenf("idle", *words, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def truth_of(clip: Path) -> dict[str, Any]:
    truth: dict[str, Any] = json.loads(clip.with_suffix(".truth.json").read_text())
    return truth


def test_a_video(rsenf: Rsenf, clip: Path) -> None:
    found, truth = estimate(rsenf, clip), truth_of(clip)
    assert set(found) == KEYS
    assert (found["verdict"], found["method"], found["reason"]) == ("estimated", "coherent", None)
    assert found["idle_ratio"] == pytest.approx(truth["idle_ratio"], abs=0.005)
    assert found["idle_ratio_low"] < found["idle_ratio"] < found["idle_ratio_high"]
    assert found["read_out_time_s"] == pytest.approx(truth["read_out_time_s"], rel=0.01)
    assert 0 < found["read_out_time_std_s"] < 0.01 * truth["read_out_time_s"]
    assert (found["direction"], found["nominal_hz"]) == ("forward", 50.0)
    assert found["frame_rate_hz"] == pytest.approx(30000 / 1001, abs=1e-3)


def test_a_video_read_out_along_its_columns(rsenf: Rsenf, tmp_path: Path) -> None:
    clip = tmp_path / "turned.mp4"
    model = tmp_path / "turned.yaml"
    model.write_text(
        "version: 2\nshutter: {rows: 180, columns: 240, idle_ratio: 0.25, read_out: columns}\n"
    )
    words = ("--out", clip, "--model", model, "--duration-s", "30", "--seed", "4")
    assert rsenf("simulate", *words).returncode == 0
    found = estimate(rsenf, clip)
    assert found["verdict"] == "estimated"
    assert found["idle_ratio"] == pytest.approx(0.25, abs=0.01)
    assert estimate(rsenf, clip, "--read-out", "columns") == found
    assert estimate(rsenf, clip, "--read-out", "rows")["verdict"] != "estimated"


def test_in_words(rsenf: Rsenf, hidden: HiddenClip) -> None:
    done = rsenf("idle", hidden.clip)
    assert done.returncode == 0
    head, *rest = done.stdout.splitlines()
    assert head.startswith("estimated: 38.0")
    assert head.endswith(" % of each frame is idle")
    names = [line.strip().split("  ")[0] for line in rest]
    assert names == ["95 % interval", "read-out time", "direction", "grid", "frame rate",
                     "what it means"]  # fmt: skip
    assert all(line.startswith("note: ") for line in done.stderr.splitlines())


@pytest.mark.processes
def test_a_recording_of_its_rows_says_the_same(rsenf: Rsenf, clip: Path, recording: Path) -> None:
    assert estimate(rsenf, recording) == estimate(rsenf, clip)


@pytest.mark.parametrize(
    ("what", "verdict"), [("noise", "no_signal"), ("mean", "refused")]
)  # fmt: skip
def test_nothing_to_say_is_a_result(rsenf: Rsenf, tmp_path: Path, what: str, verdict: str) -> None:
    time_s = np.arange(900) / 30.0
    level = np.random.default_rng(2).normal(100.0, 1.0, (900, 60))
    if what == "noise":
        np.savez(tmp_path / "in.npz", rows=level.astype(np.float32), frame_time_s=time_s)
    else:
        wave = 100.0 + 5.0 * np.cos(2 * np.pi * 100.03 * time_s)
        np.savez(tmp_path / "in.npz", luminance=wave, frame_rate_hz=29.7)
    found = estimate(rsenf, tmp_path / "in.npz")
    assert found["verdict"] == verdict
    assert found["reason"]
    unknown = {"idle_ratio", "idle_ratio_std", "idle_ratio_low", "idle_ratio_high",
               "read_out_time_s", "read_out_time_std_s", "direction"}  # fmt: skip
    assert {key for key in unknown if found[key] is not None} == set()


@pytest.fixture(scope="module")
def three(rsenf: Rsenf, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """Rows of two clips of one camera, and of one of another."""
    folder = tmp_path_factory.mktemp("three")
    paths = []
    for seed, idle_ratio in ((1, 0.3), (2, 0.3), (3, 0.4)):
        path = folder / f"clip{seed}.npz"
        words = ("--out", path, "--duration-s", 30, "--size", "64x240", "--seed", seed)
        assert rsenf("simulate", *words, "--idle-ratio", idle_ratio).returncode == 0
        paths.append(path)
    return paths[0], paths[1], paths[2]


@pytest.mark.parametrize(("other", "verdict"), [(1, "compatible"), (2, "different")])
def test_two_recordings(
    rsenf: Rsenf, three: tuple[Path, Path, Path], other: int, verdict: str
) -> None:
    found = estimate(rsenf, three[0], three[other])
    assert set(found) == {
        "recordings", "log10_lr_same_readout", "verdict", "caveats", "warnings",
    }  # fmt: skip
    assert found["recordings"] == [str(three[0]), str(three[other])]
    assert found["verdict"] == verdict
    assert (found["log10_lr_same_readout"] > 0) == (verdict == "compatible")
    assert any("prove" in line for line in found["caveats"]) == (verdict == "compatible")


def test_two_recordings_in_words(rsenf: Rsenf, three: tuple[Path, Path, Path]) -> None:
    done = rsenf("idle", three[0], three[2])
    assert done.returncode == 0
    heads = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    assert [head.split(": ")[0] for head in heads] == [str(three[0]), str(three[2]), "different"]


def test_one_of_two_without_flicker(
    rsenf: Rsenf, three: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    level = np.full((900, 60), 100.0, np.float32)
    np.savez(tmp_path / "dark.npz", rows=level, frame_time_s=np.arange(900) / 30.0)
    found = estimate(rsenf, three[0], tmp_path / "dark.npz")
    assert (found["verdict"], found["log10_lr_same_readout"]) == ("undecidable", None)
    assert any("no read-out time: " in line for line in found["caveats"])


def test_no_such_method(rsenf: Rsenf, hidden: HiddenClip) -> None:
    done = rsenf("idle", hidden.clip, "--method", "guess")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("rsenf: argument --idle-method/--method: no 'guess' (one of ")


def test_no_such_file(rsenf: Rsenf) -> None:
    done = rsenf("idle", "gone.mp4")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("rsenf: gone.mp4: no such file")
