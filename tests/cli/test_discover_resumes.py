"""A long run that was stopped goes on where it was, and comes to the very same."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rsenf.api.recordings import begun
from rsenf.errors import InputError, UsageError

# Interrupts itself when all is found and nothing written.
STOPPED = """
import os, signal, sys
from rsenf.api.discover import DiscoverResult
from rsenf.cli import main

DiscoverResult.write = lambda *told: os.kill(os.getpid(), signal.SIGINT)
sys.exit(main(sys.argv[1:]))
"""
# Neither samples a video nor codes one.
BY_WHAT_IS_KEPT = """
import sys
import rsenf.run.inline
from rsenf.cli import main

def analyse(*told, **more):
    raise AssertionError("read again")

rsenf.run.inline.analyse = analyse
sys.exit(main(sys.argv[1:]))
"""


def python(program: str, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_video_is_read_and_coded_once(rsenf: Callable, tmp_path: Path) -> None:
    clip, found, whole = tmp_path / "clip.mp4", tmp_path / "found", tmp_path / "whole"
    rsenf("simulate", "--out", clip, "--duration-s", 26, "--size", "96x72", "--seed", 4,
          "--bitrate", "60k")  # fmt: skip
    stopped = python(STOPPED, "discover", clip, "--out", found)
    assert stopped.returncode == 130, stopped.stderr
    assert "going on" not in stopped.stderr
    assert not found.exists()
    kept = tmp_path / ".found.begun"
    assert len(list(kept.iterdir())) >= 2  # its rows, and those of a model coded like them
    resumed = python(BY_WHAT_IS_KEPT, "discover", clip, "--out", found)
    assert resumed.returncode == 0, resumed.stderr
    assert "going on from what" in resumed.stderr
    assert not kept.exists()
    assert rsenf("discover", clip, "--out", whole).returncode == 0
    one, other = (json.loads((out / "discovery.json").read_text()) for out in (found, whole))
    assert one | {"model_out": ""} == other | {"model_out": ""}


def answer(run: object, value: float, of: bytes = b"x") -> float:
    made = run.kept(of, lambda: {"value": np.array(value)})  # type: ignore[attr-defined]
    return float(made["value"])


def run_that_ends(out: Path, of: str, value: float, how: type[BaseException]) -> None:
    with begun(out, of) as run:
        assert answer(run, value) == value
        assert not run.found
        raise how("for a test")


def stopped_after(out: Path, of: str, value: float) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_that_ends(out, of, value, KeyboardInterrupt)


def test_only_the_very_same_is_used_again(tmp_path: Path) -> None:
    out = tmp_path / "out"
    stopped_after(out, "one", 1.0)
    stopped_after(out, "another", 2.0)
    with begun(out, "one") as run:
        assert answer(run, 3.0) == 1.0
        assert answer(run, 4.0, b"y") == 4.0
        assert run.found
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", [b"", b"PK", None])
def test_what_is_damaged_is_made_anew(damage: bytes | None, tmp_path: Path) -> None:
    stopped_after(tmp_path / "out", "one", 1.0)
    (path,) = (tmp_path / ".out.begun").iterdir()
    path.write_bytes(path.read_bytes()[:-30] if damage is None else damage)
    with begun(tmp_path / "out", "one") as run:
        assert answer(run, 2.0) == 2.0
        assert not run.found


def test_a_recording_of_no_use_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        run_that_ends(tmp_path / "out", "one", 1.0, InputError)
    assert list(tmp_path.iterdir()) == []


def test_what_else_goes_wrong_costs_nothing_that_was_done(tmp_path: Path) -> None:
    stopped_after(tmp_path / "out", "one", 1.0)
    with pytest.raises(UsageError), begun(tmp_path / "out", "another"):
        raise UsageError("a misspelt name")
    with begun(tmp_path / "out", "one") as run:
        assert answer(run, 2.0) == 1.0


def test_without_room_nothing_is_kept_and_nothing_fails(tmp_path: Path) -> None:
    (tmp_path / "a file").write_text("")
    with begun(tmp_path / "a file" / "out", "one") as run:
        assert answer(run, 1.0) == 1.0
