"""A quick run from end to end, in processes; stopped and resumed."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rsenf.bench.harness import measure_missing
from rsenf.bench.measure import measure
from rsenf.bench.scenes import Plan, SceneClip
from rsenf.cli import bench, main
from rsenf.errors import NodeFailed
from rsenf.idle import METHODS as IDLE_METHODS
from rsenf.track import METHODS as ENF_METHODS

TINY = Plan(sizes=("240p",), frame_rates=("29.97",), codings=("lossless",), clips=3, duration_s=1.0)
MEASURE = partial(measure, grids=None)


class Stopped(Exception):
    """What a test stops a run with."""


@dataclass(frozen=True)
class Deadly(SceneClip):
    """A clip that ends the process that is to measure it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os._exit, (7,)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    assert main(["bench", "enf", "--quick", "--out", str(folder), "--json"]) == 0
    return folder


def test_quick_run_measures_every_method_on_every_coding(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (out / "clips.jsonl").read_bytes()
    assert main(["bench", "idle", "--quick", "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    # The second table needs no second run.
    assert (out / "clips.jsonl").read_bytes() == before
    assert {row["method"] for row in document["rows"]} == set(IDLE_METHODS)
    assert {row["coding"] for row in document["rows"]} == {"lossless", "50k"}
    assert all(row["broke"] == 0 for row in document["rows"])
    record = json.loads(before.splitlines()[0])
    assert set(record["found"]["50k"]["enf"]) == set(ENF_METHODS)
    assert record["versions"]["rsenf"]


def test_quick_run_finds_the_enf(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "enf", "--table-only", "--out", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    plain = [r for r in rows if (r["method"], r["coding"]) == ("stft", "lossless")]
    assert 0 < max(r["median_mhz"] or 0.0 for r in plain) < 10


def test_fleets_are_drawn_from_the_same_clips(
    out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["bench", "cameras", "--table-only", "--fleets", "1", "--out", str(out)]
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["estimates"] > 0
    assert [case["recordings"] for case in told["cases"]] == [50, 50]
    assert main(words) == 0
    assert "1 fleets of 50 cameras" in capsys.readouterr().out


@pytest.mark.parametrize("how", [[], ["--markdown"]])
def test_tables_for_people(out: Path, how: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "idle", "--table-only", "--out", str(out), *how]) == 0
    assert "29.97 fps 50 Hz" in capsys.readouterr().out


def test_a_stopped_run_loses_and_repeats_nothing(tmp_path: Path) -> None:
    file, clips = tmp_path / "clips.jsonl", {clip.key: (clip,) for clip in TINY.lit()}

    def stop(done: int, missing: int) -> None:
        if done == 1:
            raise Stopped

    with pytest.raises(Stopped):
        measure_missing(clips, MEASURE, file, 1, stop)
    kept = file.read_bytes()
    assert kept.count(b"\n") == 1
    records = measure_missing(clips, MEASURE, file, 2)
    assert file.read_bytes().startswith(kept)
    assert [r["key"] for r in records] == list(clips)
    assert file.read_bytes().count(b"\n") == len(clips)
    assert measure_missing(clips, MEASURE, file, 2) == records


def test_a_process_that_dies_is_named(tmp_path: Path) -> None:
    deadly = Deadly("lit", "240p", "25", 50.0, 5, 1.0)
    with pytest.raises(NodeFailed, match="'lit 240p 25fps 50Hz 5 1s"):
        measure_missing({deadly.key: (deadly,)}, MEASURE, tmp_path / "clips.jsonl", 1)


def test_a_clip_that_cannot_be_measured_stops_the_run(tmp_path: Path) -> None:
    clip = SceneClip("lit", "99p", "25", 50.0, 5, 1.0)
    with pytest.raises(NodeFailed, match="KeyError"):
        measure_missing({clip.key: (clip,)}, MEASURE, tmp_path / "clips.jsonl", 1)


def test_table_only_needs_a_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "idle", "--table-only"]) == 2
    assert "--out" in capsys.readouterr().err


def test_the_verb_explains_itself() -> None:
    assert "Cramér–Rao" in (bench.__doc__ or "")


TINY_FILMS = ["recording-time", "--sizes", "240p", "--codings", "lossless", "--clips", "2"]


def test_recording_time_films_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Shorter than any piece: filmed, and nothing to try.
    words = ["bench", *TINY_FILMS, "--duration-s", "2", "--out", str(tmp_path), "--jobs", "2"]
    assert main([*words, "--grids", str(tmp_path)]) == 0
    films = (tmp_path / "films.jsonl").read_bytes()
    assert sorted(json.loads(line)["kind"] for line in films.splitlines()) == ["moving", "still"]
    capsys.readouterr()
    assert main([*words, "--json", "--grids", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "films: 0 of 2" in said.err
    assert json.loads(said.out)["rows"] == []
    assert (tmp_path / "films.jsonl").read_bytes() == films


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--frame-rates", "25"], "--frame-rates"),
        (["--nominal-hz", "60"], "--nominal-hz"),
        (["--sizes", "240p,480p"], "no size '240p,480p'"),
        (["--codings", "150"], "not a coding"),
        (["--table-only"], "--out"),
    ],
)
def test_what_recording_time_does_not_take(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "recording-time", *words]) == 2
    assert told in capsys.readouterr().err
