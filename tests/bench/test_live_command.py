"""The study of live verdicts from the command line: stopped, resumed, tabulated, fitted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rsenf.cli import main

RUN = ["bench", "live", "--duration-s", "90", "--seed", "3", "--jobs", "1", "--json"]


@pytest.mark.processes
def test_a_run_goes_on_where_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)  # away from measured grids, if there are any
    for clips in ("1", "2"):
        capsys.readouterr()
        assert main([*RUN, "--clips", clips, "--out", "kept"]) == 0
    document = json.loads(capsys.readouterr().out)
    lines = (tmp_path / "kept" / "live.jsonl").read_text().splitlines()
    assert [json.loads(line)["seed"] for line in lines] == [3, 4]
    assert document["feeds"] == 2
    assert document["grids"] == ["synthetic"]
    assert all(r["hours"] == pytest.approx(0.05) for r in document["honest"])
    assert main([*RUN, "--table-only", "--out", "kept"]) == 0
