"""The file of records: nothing lost, nothing twice."""

from __future__ import annotations

from pathlib import Path

import pytest

from rsenf.batch.journal import Journal, read_records
from rsenf.errors import InputError, RecordingError


def test_records_come_back(tmp_path: Path) -> None:
    with Journal(tmp_path / "new" / "r.jsonl") as journal:
        journal.add({"key": "a", "x": 1})
        journal.add({"key": "b", "x": 2})
    assert list(read_records(tmp_path / "new" / "r.jsonl")) == ["a", "b"]


def test_a_line_that_was_never_finished_is_taken_away(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    path.write_text('{"key":"a","x":1}\n{"key":"b","x"')
    with Journal(path) as journal:
        assert list(journal.records) == ["a"]
        journal.add({"key": "b", "x": 3})
    assert path.read_text() == '{"key":"a","x":1}\n{"key":"b","x":3}\n'


def test_only_what_was_asked_for_in_its_order(tmp_path: Path) -> None:
    with Journal(tmp_path / "r.jsonl") as journal:
        for key in "abc":
            journal.add({"key": key})
        assert [r["key"] for r in journal.of(["c", "x", "a"])] == ["c", "a"]


@pytest.mark.parametrize("line", ["not json", "[1]", '{"x":1}', "[" * 100_000])
def test_another_file_is_left_alone(tmp_path: Path, line: str) -> None:
    path = tmp_path / "r.jsonl"
    path.write_text(line + "\n")
    with pytest.raises(InputError, match=r"r\.jsonl:1"):
        Journal(path)
    assert path.read_text() == line + "\n"


def test_nowhere_to_write(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError):
        Journal(tmp_path / "file" / "r.jsonl")
