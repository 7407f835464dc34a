"""`rsenf verify --report`: beside any other output, reproducible, and refused early where unfit."""

from __future__ import annotations

import json
import platform
import shlex
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsenf.cli import verb_parser
from rsenf.cli.verify import command_again
from tests.cli.bad_files import cut, repacked
from tests.hidden_clip import HiddenClip
from tests.report.html_page import Page

Rsenf = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(autouse=True)
def fixed_date(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1767312245")


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def short(hidden: HiddenClip, tmp_path_factory: pytest.TempPathFactory) -> HiddenClip:
    """The hidden clip's first minute, and less of its reference: quick to search."""
    folder = tmp_path_factory.mktemp("short")
    with np.load(hidden.clip) as held:
        rows, times = held["rows"][:1800], held["frame_time_s"][:1800]
    np.savez(folder / "clip.npz", rows=rows, frame_time_s=times)
    lines = hidden.reference.read_text().splitlines()
    (folder / "grid.csv").write_text("\n".join(lines[:1] + lines[2001:3201]) + "\n")
    return HiddenClip(folder / "clip.npz", folder / "grid.csv", 345.4, hidden.start_utc)


def test_json_and_report_together_wherever_the_files_are(
    rsenf: Rsenf, short: HiddenClip, tmp_path: Path
) -> None:
    """Two runs from different folders: the same bytes, and no path in them."""
    elsewhere = tmp_path / "another place"
    elsewhere.mkdir()
    shutil.copy(short.clip, elsewhere)
    shutil.copy(short.reference, elsewhere)
    words = ["--start", short.start_utc, "--report"]
    first = rsenf("verify", short.clip, "--reference", short.reference, *words, tmp_path / "a",
                  "--json")  # fmt: skip
    assert first.returncode == 0, first.stderr
    second = rsenf("verify", "clip.npz", "--reference", "grid.csv", *words, "b", cwd=elsewhere)
    assert second.returncode == 0, second.stderr
    assert contents(tmp_path / "a") == contents(elsewhere / "b")
    numbers = json.loads((tmp_path / "a" / "report.json").read_text())
    assert first.stdout == (tmp_path / "a" / "result.json").read_text()
    assert json.loads(first.stdout) == numbers["result"]
    assert numbers["made_utc"] == "2026-01-02T00:04:05Z"
    assert numbers["inputs"]["recording"]["name"] == "clip.npz"
    assert numbers["inputs"]["recording"]["bytes"] == short.clip.stat().st_size
    assert numbers["inputs"]["references"][0]["bytes"] == short.reference.stat().st_size
    assert numbers["parameters"]["asked for"]["reference"] == ["grid.csv"]
    assert numbers["idle"]["verdict"] == "estimated"
    assert {"rsenf", "commit", "processor", "numpy", "libavcodec"} <= numbers["versions"].keys()
    assert numbers["versions"]["operating system"] == platform.platform()
    # The command makes the same report, wherever the files are.
    assert numbers["command"] == (
        f"rsenf verify clip.npz --reference grid.csv --start {short.start_utc} --report report"
    )
    again = rsenf(*shlex.split(numbers["command"])[1:], cwd=elsewhere)
    assert again.returncode == 0, again.stderr
    assert contents(elsewhere / "report") == contents(tmp_path / "a")
    everything = b"".join(contents(tmp_path / "a").values())
    assert str(tmp_path).encode() not in everything
    assert str(short.clip.parent).encode() not in everything
    page = Page((tmp_path / "a" / "report.html").read_text())
    assert numbers["answer"] in page.words
    assert len(page.all("img")) == 5
    assert f"report: {Path('b') / 'report.html'}" in second.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("exhibits: E-3\n", ":1: unknown key 'exhibits'"),
        ("case: 1\nexaminer: [a, b]\n", ":2: examiner: "),
        ("just words\n", ":1: not a mapping"),
    ],
)
def test_a_case_file_that_is_none(
    rsenf: Rsenf, short: HiddenClip, tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "case.yaml").write_text(text)
    done = rsenf("verify", short.clip, "--reference", short.reference, "--case",
                 tmp_path / "case.yaml", "--report", tmp_path / "r")  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert f"case.yaml{said}" in done.stderr
    assert not (tmp_path / "r").exists()


def test_every_option_that_matters_is_in_the_command(tmp_path: Path) -> None:
    for name in ("clip.mp4", "a.csv"):
        (tmp_path / name).touch()
    words = ["--method", "ncc", "--candidates", "3", "--no-mask", "--min-fit", "0.001",
             "--reference", "store:ce", "--frame-rate", "29.97"]  # fmt: skip
    args = verb_parser("verify").parse_args([
        str(tmp_path / "clip.mp4"), "--reference", str(tmp_path / "a.csv"), *words, "--json",
        "--picture", str(tmp_path / "p.png"), "--report", str(tmp_path / "r"),
    ])  # fmt: skip
    first, verb, *again = shlex.split(command_again(args))
    assert (first, verb) == ("rsenf", "verify")
    assert str(tmp_path) not in "".join(again)
    same = verb_parser("verify").parse_args(again)
    kept = {"input", "reference", "json", "picture", "report"}
    assert {k: v for k, v in vars(same).items() if k not in kept} == {
        k: v for k, v in vars(args).items() if k not in kept
    }
    assert (same.input, same.reference) == ("clip.mp4", ["a.csv", "store:ce"])


def test_darkness_is_reported_too(rsenf: Rsenf, short: HiddenClip, tmp_path: Path) -> None:
    noise = np.random.default_rng(2).normal(100.0, 1.0, 1800)
    np.savez(tmp_path / "noise.npz", luminance=noise, frame_rate_hz=30.0)
    done = rsenf("verify", tmp_path / "noise.npz", "--reference", short.reference, "--report",
                 tmp_path / "r")  # fmt: skip
    assert done.returncode == 0, done.stderr
    page = Page((tmp_path / "r" / "report.html").read_text())
    assert "What would help" in page.words
    assert "no usable signal" in page.words


def test_a_damaged_clip_is_reported_with_its_loss(
    rsenf: Rsenf, clip: Path, short: HiddenClip, tmp_path: Path
) -> None:
    whole = repacked(clip, tmp_path / "whole.mkv", {})
    part = cut(whole, tmp_path / "cut.mkv", 0.8)
    done = rsenf("verify", part, "--reference", short.reference, "--method", "ncc", "--report",
                 tmp_path / "r")  # fmt: skip
    assert done.returncode == 3, done.stderr
    numbers = json.loads((tmp_path / "r" / "report.json").read_text())
    assert numbers["warnings"][-1] in done.stderr
    assert numbers["warnings"][-1] in Page((tmp_path / "r" / "report.html").read_text()).words


@pytest.mark.parametrize("held", ["notes.txt", "report.html"])
def test_a_folder_of_something_else_is_refused_before_the_work(
    rsenf: Rsenf, short: HiddenClip, tmp_path: Path, held: str
) -> None:
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / held).write_text("mine")
    done = rsenf("verify", tmp_path / "no clip needed", "--reference", short.reference, "--report",
                 tmp_path / "r")  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"rsenf: --report {tmp_path / 'r'}: holds what is no report: {held}")
    assert contents(tmp_path / "r") == {held: b"mine"}


def test_a_moment_that_is_none(
    rsenf: Rsenf, short: HiddenClip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    done = rsenf("verify", short.clip, "--reference", short.reference, "--report", tmp_path / "r")
    assert (done.returncode, done.stdout) == (2, "")
    assert "SOURCE_DATE_EPOCH='yesterday'" in done.stderr
    assert not (tmp_path / "r").exists()
