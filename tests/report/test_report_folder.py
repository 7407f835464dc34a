"""A report takes the place of an earlier one whole, and of nothing else."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from rsenf.errors import RecordingError, UsageError
from rsenf.report import recording_time
from rsenf.report.recording_time import check_folder, moment_of_report, write_report
from tests.report.report_cases import bare_case

MADE = "2026-01-02T03:04:05Z"


@pytest.fixture(scope="module")
def case() -> Any:
    return bare_case()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_new_folder_an_empty_one_and_an_earlier_report(tmp_path: Path, case: Any) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("new", "empty", "new"):
        check_folder(tmp_path / name)
        write_report(tmp_path / name, case, MADE)
        assert (tmp_path / name / "report.html").is_file()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty", "new"]


def test_an_earlier_report_goes_with_all_its_files(tmp_path: Path, case: Any) -> None:
    folder = tmp_path / "r"
    write_report(folder, case, MADE)
    text = (folder / "report.json").read_text()
    (folder / "report.json").write_text(
        text.replace('"report.html"', '"report.html", "old.png"', 1)
    )
    (folder / "old.png").write_bytes(b"of an older version")
    write_report(folder, case, MADE)
    assert not (folder / "old.png").exists()


@pytest.mark.parametrize(
    "held", [{"notes.txt": ""}, {"report.json": "{}"}, {"report.json": "no JSON"},
             {"report.json": '{"schema": "rsenf.report.recording_time"}'},
             {"report.html": "somebody else's"}]
)  # fmt: skip
def test_a_folder_of_anything_else_is_refused(tmp_path: Path, held: dict[str, str]) -> None:
    folder = tmp_path / "r"
    folder.mkdir()
    for name, text in held.items():
        (folder / name).write_text(text)
    with pytest.raises(UsageError, match="holds what is no report") as caught:
        check_folder(folder)
    assert next(iter(held)) in str(caught.value)


def test_a_note_beside_a_report_is_not_lost(tmp_path: Path, case: Any) -> None:
    write_report(tmp_path / "r", case, MADE)
    (tmp_path / "r" / "my notes.txt").write_text("hours of work")
    before = contents(tmp_path)
    with pytest.raises(UsageError, match=r"my notes\.txt"):
        write_report(tmp_path / "r", case, MADE)
    assert contents(tmp_path) == before


def test_places_that_are_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.chdir(tmp_path)
    for path, reason in (
        (tmp_path / "file", "this is a file"),
        (tmp_path / "no" / "r", "no such folder"),
        (Path(), "current folder"),
    ):
        with pytest.raises(UsageError, match=reason):
            check_folder(path)


@pytest.mark.parametrize("earlier", [True, False])
@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_report_that_breaks_off_leaves_what_was_there(
    tmp_path: Path, case: Any, monkeypatch: pytest.MonkeyPatch, earlier: bool, failure: Exception
) -> None:
    if earlier:
        write_report(tmp_path / "r", case, MADE)
    before = contents(tmp_path)

    def broken(*_: object, **__: object) -> None:
        raise failure

    monkeypatch.setattr(Path, "write_text", broken)
    with pytest.raises((RecordingError, KeyboardInterrupt)):
        write_report(tmp_path / "r", case, "2027-01-01T00:00:00Z")
    assert contents(tmp_path) == before
    assert [p.name for p in tmp_path.iterdir()] == (["r"] if earlier else [])


def test_an_interruption_between_the_two_steps_brings_the_old_report_back(
    tmp_path: Path, case: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_report(tmp_path / "r", case, MADE)
    before, replace = contents(tmp_path), os.replace

    def interrupted(source: Path, target: Path) -> None:
        if source.suffix == ".part":
            raise KeyboardInterrupt
        replace(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_report(tmp_path / "r", case, "2027-01-01T00:00:00Z")
    assert contents(tmp_path) == before


def test_nothing_is_written_before_all_is_drawn(
    tmp_path: Path, case: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> str:
        raise ValueError("in the page")

    monkeypatch.setattr(recording_time, "page_of", broken)
    with pytest.raises(ValueError, match="in the page"):
        write_report(tmp_path / "r", case, MADE)
    assert list(tmp_path.iterdir()) == []


def test_the_moment_is_the_environment_s_where_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    assert moment_of_report() == "2023-11-14T22:13:20Z"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "")
    assert moment_of_report() > "2024"
    for wrong in ("tomorrow", "1e99", "9" * 30):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", wrong)
        with pytest.raises(UsageError, match="SOURCE_DATE_EPOCH"):
            moment_of_report()
