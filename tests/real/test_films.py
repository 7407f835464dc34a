"""A scene is filmed, dark and lit, and what is said of it is told; the next run adds the rest."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.real import films

SEED = 40033  # rain, 48 frames/s


def test_a_scene_is_dark_and_lit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, drawn = tmp_path / "films.jsonl", tmp_path / "films.png"
    words = [str(SEED), str(SEED + 1), "--out", str(out), "--methods", "projection", "coherent"]
    films.main([*words, "--only", "lit"])
    films.main([*words, "--picture", str(drawn)])
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    assert [line["lit"] for line in lines] == [True, False]
    lit, dark = (line["said"] for line in lines)
    assert lit["projection"]["rms_hz"] < 2e-3
    assert abs(lit["coherent"]["z"]) < 4.0
    assert not any(films.is_claimed(told) for told in dark.values())
    told = capsys.readouterr().out
    assert "1/1" in told
    assert "0 of 1 (" in told
    assert drawn.exists()


def test_a_false_claim_is_counted_and_a_wrong_one_named(capsys: pytest.CaptureFixture[str]) -> None:
    about = {"kind": "text", "rate": "24", "coding": "lossless", "alias_hz": 4.0}
    about |= {"flicker_ratio": 0.01}
    off = {"usable": 3, "rms_hz": 0.5, "rms_z": 50.0}
    dark = {"seed": 1, "lit": False, **about, "said": {"stft": {"usable": 1}}}
    films.summary([dark, {"seed": 2, "lit": True, **about, "said": {"stft": off}}])
    told = capsys.readouterr().out
    assert "1 of 1 (100.00 %)" in told
    assert "stft false: text 1" in told
    assert "stft wrong at 1 %: text 2" in told
