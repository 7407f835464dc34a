"""The store from the command line: words, JSON, exit codes, one line for each mistake."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.cli import main
from rsenf.reference import read_reference
from tests.reference.reference_files import T0_NS, values
from tests.reference.store_files import write_csv

Done = subprocess.CompletedProcess[str]
Verb = Callable[..., Done]
DAY = T0_NS // 10**9


@pytest.fixture
def verb(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Verb:
    """Call ``rsenf reference``, in this process, with a store of the test's own."""
    monkeypatch.setenv("RSENF_STORE", str(tmp_path / "store"))

    def call(*words: object) -> Done:
        code = main(["reference", *map(str, words)])
        return subprocess.CompletedProcess(words, code, *capsys.readouterr())

    return call


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """A minute and the next one, of which ten seconds are missing and five are in both."""
    seconds, freq = DAY + np.arange(120), values(120)
    parts = {"one.csv": np.r_[0:60], "two.csv": np.r_[55:80, 90:120]}
    return [write_csv(tmp_path / name, seconds[p], freq[p]) for name, p in parts.items()]


def answer(done: Done) -> Any:
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def refusal(done: Done) -> str:
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    (line,) = done.stderr.splitlines()
    return line


def test_in_words(verb: Verb, files: list[Path], tmp_path: Path) -> None:
    done = verb("import", *files, "--grid", "ce")
    assert done.returncode == 0
    assert done.stdout.splitlines() == [
        "one.csv: 60 samples to ce@1, 2022-09-17T00:00:00.000Z to 2022-09-17T00:01:00.000Z",
        "two.csv: 55 samples to ce@1, 2022-09-17T00:00:55.000Z to 2022-09-17T00:02:00.000Z",
    ]
    again = verb("import", files[0], "--grid", "ce")
    assert re.fullmatch(r"one\.csv: in ce@1 already, since 20\S+Z\n", again.stdout)
    listed = verb("list").stdout.splitlines()
    assert listed[1].split()[:6] == [
        "ce", "50", "1", "s", "2022-09-17T00:00:00.000Z", "2022-09-17T00:02:00.000Z",
    ]  # fmt: skip
    assert "91.7%" in listed[1]
    told = verb("info", "ce").stdout
    assert "values          110 of 120 (91.7%)" in told
    assert "gaps            1, in all 0:00:10" in told
    assert "0:00:10 from 2022-09-17T00:01:20.000Z" in told
    assert "duplicates      5 samples" in told
    assert "contradictions  0 of them" in told
    assert told.count("sha256") == 2
    done = verb("export", "ce@1", "--out", tmp_path / "out.csv", "--to", "2022-09-17T00:01:00.000Z")
    assert done.stdout == (
        f"{tmp_path / 'out.csv'}: 60 values of ce at 1 s, "
        "2022-09-17T00:00:00.000Z to 2022-09-17T00:01:00.000Z\n"
    )
    np.testing.assert_array_equal(read_reference(tmp_path / "out.csv").freq_hz, values(120)[:60])


def test_as_json(verb: Verb, files: list[Path], tmp_path: Path) -> None:
    told = answer(verb("import", *files, "--grid", "ce", "--json"))
    assert told["store"] == str(tmp_path / "store")
    assert [(i["file"], i["new"], i["samples"]) for i in told["imports"]] == [
        ("one.csv", True, 60), ("two.csv", True, 55),
    ]  # fmt: skip
    (listed,) = answer(verb("list", "--json"))["series"]
    assert listed["size_bytes"] > 0
    del listed["size_bytes"]
    assert listed == {
        "grid": "ce", "nominal_hz": 50.0, "step_s": 1.0, "start_utc": "2022-09-17T00:00:00.000Z",
        "end_utc": "2022-09-17T00:02:00.000Z", "coverage": 0.916667, "imports": 2,
    }  # fmt: skip
    (info,) = answer(verb("info", "ce", "--json"))["series"]
    assert (info["samples"], info["valid"], info["gaps"]) == (120, 110, 1)
    assert info["longest_gaps"] == [{"start_utc": "2022-09-17T00:01:20.000Z", "duration_s": 10.0}]
    assert (info["duplicates"], info["contradictions"]) == (5, 0)
    assert info["std_hz"] == pytest.approx(
        np.std(np.r_[values(120)[:80], values(120)[90:]]), abs=1e-6
    )
    assert {i["file"]: len(i["sha256"]) for i in info["imports"]} == {"one.csv": 64, "two.csv": 64}
    assert {i["options"]["stamp"] for i in info["imports"]} == {"start"}
    out = tmp_path / "out.parquet"
    told = answer(verb("export", "ce", "--from", "2022-09-17T00:01", "--out", out, "--json"))
    assert (told["values"], told["start_utc"]) == (50, "2022-09-17T00:01:00.000Z")
    assert read_reference(out).valid_samples == 50


def test_an_empty_store(verb: Verb) -> None:
    assert answer(verb("list", "--json"))["series"] == []
    done = verb("list")
    assert (done.returncode, done.stdout) == (0, "")
    assert "is empty; rsenf reference import FILE adds a grid" in done.stderr


def test_options_of_reading(verb: Verb, tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("f,Boston\n" + "\n".join(f"1,{f + 10}" for f in values(50)))
    words = ["--step-s", "2", "--column", "Boston", "--nominal-hz", "60", "--stamp", "centre"]
    done = verb("import", path, *words, "--start", "2022-09-17T02:00+02:00")
    assert done.stdout == (
        "mine.csv: 50 samples to mine@2, 2022-09-16T23:59:59.000Z to 2022-09-17T00:01:39.000Z\n"
    )


def test_a_store_that_is_named(verb: Verb, files: list[Path], tmp_path: Path) -> None:
    assert verb("import", files[0], "--store", tmp_path / "mine").returncode == 0
    assert list((tmp_path / "mine" / "one" / "1s").glob("*.parquet"))
    assert not (tmp_path / "store").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "the following arguments are required: import|list|info|export"),
        (["remove", "ce"], "no 'remove'"),
        (["import"], "the following arguments are required: FILE"),
        (["import", "gone.csv"], "no reference file gone.csv (look for a misspelling)"),
        (["import", "a.csv", "b.csv"], "2 files and no name for their grid (--grid NAME)"),
        (["import", "a.csv", "--timezone", "Mars"], "no time zone 'Mars'"),
        (["import", "a.csv", "--start", "soon"], "--start 'soon' is not a time"),
        (["import", "{text}"], "no frequency column in prose.csv"),
        (["import", "{good}", "--grid", "a/b"], "'a/b' is no name for a grid"),
        (["import", "{good}", "--nominal-hz", "60"], "but a nominal frequency of 60 Hz"),
        (["info", "ce"], "no grid 'ce' in the store"),
        (["export", "ce"], "the following arguments are required: --out"),
        (["export", "ce", "--out", "x.csv", "--from", "soon"], "--from 'soon' is not a time"),
    ],
)
def test_mistakes_are_one_line(verb: Verb, words: list[str], says: str, tmp_path: Path) -> None:
    (tmp_path / "prose.csv").write_text("It was a dark night.\nAnd stormy.\n")
    write_csv(tmp_path / "good.csv", DAY + np.arange(50), values(50))
    named = {"text": tmp_path / "prose.csv", "good": tmp_path / "good.csv"}
    before = sorted(tmp_path.rglob("*"))
    assert says in refusal(verb(*(w.format(**named) for w in words)))
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("what", ["import", "list", "info", "export"])
def test_help_of_each(verb: Verb, what: str) -> None:
    done = verb(what, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"usage: rsenf reference {what} ")
