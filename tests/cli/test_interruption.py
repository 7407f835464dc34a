"""Ctrl-C and SIGTERM: one line, exit code 130, nothing half-written, whatever is under way."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.hidden_clip import HiddenClip

# Sends itself a real signal in the middle of the recording's row blocks: no clock is involved.
IN_THE_MIDDLE = """
import os, sys
from rsenf.cli import main
from rsenf.run.inputs import Luminance

whole = Luminance.messages

def broken_off(self):
    for number, block in enumerate(whole(self)):
        if number == 200:
            os.kill(os.getpid(), int(sys.argv[1]))
        yield block

Luminance.messages = broken_off
sys.exit(main(sys.argv[2:]))
"""
SIGNALS = [signal.SIGINT, signal.SIGTERM]


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("verb", ["track", "verify"])
def test_analysis_stops(
    verb: str, number: signal.Signals, hidden: HiddenClip, tmp_path: Path
) -> None:
    picture = tmp_path / "picture.png"
    more = ["--reference", str(hidden.reference), "--picture", str(picture)]
    words = [verb, str(hidden.clip), *(more if verb == "verify" else [])]
    done = subprocess.run(
        [sys.executable, "-c", IN_THE_MIDDLE, str(int(number)), *words],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (130, "rsenf: interrupted\n")
    assert list(tmp_path.iterdir()) == []
    if verb == "verify":
        assert done.stdout == ""
        return
    whole = subprocess.run(
        [sys.executable, "-m", "rsenf.cli", *words], capture_output=True, text=True, check=True
    ).stdout
    assert done.stdout.endswith("\n")  # whole lines, printed as they came
    assert whole.startswith(done.stdout)
    assert len(done.stdout) < len(whole)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("verb", ["simulate", "demo"])
def test_a_clip_in_the_making_goes(verb: str, number: signal.Signals, tmp_path: Path) -> None:
    out = tmp_path / ("clip.mp4" if verb == "simulate" else "demo")
    command = [sys.executable, "-m", "rsenf.cli", verb, "--out", out, "--duration-s", "3600"]
    with subprocess.Popen(
        [str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while not any(path.stat().st_size for path in tmp_path.rglob(".clip.*.part.mp4")):
            assert process.poll() is None, process.communicate()
            time.sleep(0.01)  # only so as not to take the processor from what is waited for
        process.send_signal(number)
        out_text, err_text = process.communicate()
    lines = err_text.splitlines()
    assert (process.returncode, out_text, lines[-1]) == (130, "", "rsenf: interrupted")
    assert lines[:-1] in (
        [],
        ["rsenf: 1/3 simulating a clip of a wall under a lamp, on a grid of its own"],
    )
    assert [p.name for p in tmp_path.rglob("*") if p.is_file()] in ([], ["reference.csv"])
