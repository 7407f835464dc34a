"""``rsenf verify --method metric1 … metric4``: the paper's procedure from the command line."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable

from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]


def test_a_metric_picks_the_papers_tracker_by_itself(rsenf: Rsenf, hidden: HiddenClip) -> None:
    done = rsenf(
        "verify", hidden.clip, "--reference", hidden.reference, "--json",
        "--method", "metric3", "--start", hidden.start_utc, "--interpolation", "harmonic",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["method"], told["decision"], told["claim"]) == ("metric3", "match", "supported")
    assert abs(told["lag_s"] - hidden.lag_s) <= 1.0
    assert told["correlation"] > 0.94
    assert told["idle_ratio"] is not None
    assert told["search_size"] > 160 * 7000
    assert told["log10_lr"] is None
    assert told["log10_lr_absent"] is None
    assert told["verbal"] == ""
    assert any("no likelihood ratio" in line for line in told["warnings"])


def test_in_words(rsenf: Rsenf, hidden: HiddenClip) -> None:
    done = rsenf("verify", hidden.clip, "--reference", hidden.reference, "--method", "metric1")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("match: the recording begins 2024-03-01T10:39:0")
    assert "idle period     taken for 0% of a frame's time" in done.stdout
    assert "nan" not in done.stdout
    assert "no likelihood ratio" in done.stderr


def test_what_does_not_go_together_is_refused(rsenf: Rsenf, hidden: HiddenClip) -> None:
    verify = ("verify", hidden.clip, "--reference", hidden.reference)
    for words, says in (
        ((*verify, "--method", "metric3", "--enf-method", "stft"), "compares the hypotheses of"),
        (
            (*verify, "--method", "metric4", "--line", "0"),
            "paper takes no line: tries",
        ),
        (
            (*verify, "--method", "metric4", "--interpolation", "cubic"),
            "--interpolation: no 'cubic'",
        ),
        (("track", hidden.clip, "--interpolation", "linear"), "projection takes no interpolation"),
    ):
        done = rsenf(*words)
        assert (done.returncode, done.stdout) == (2, ""), words
        assert says in done.stderr
        assert len(done.stderr.splitlines()) == 1


def test_track_prints_what_the_tracker_stands_behind(rsenf: Rsenf, hidden: HiddenClip) -> None:
    done = rsenf("track", hidden.clip, "--method", "paper", "--json")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line["t_s"] for line in lines] == [10.0 + k for k in range(101)]
    assert all(line["usable"] for line in lines)
    assert done.stderr.startswith("note: 101 of 101 values usable; 50 Hz grid, harmonic 1 on")
