"""Which recordings are meant: each once, results and what isn't a recording left out."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rsenf.batch.settings import JOURNAL, find_recordings, read_list
from rsenf.errors import UsageError


def names(folder: Path, *paths: Path, out: str = "out") -> list[str]:
    found = find_recordings(map(str, paths or [folder]), folder / out)
    return [os.path.relpath(recording.path, folder) for recording in found.recordings]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    files = "b.mp4 a.MOV in/c.mcap in/notes.txt README .hidden.mp4 .trash/d.mp4"
    for name in f"{files} out/batch.jsonl out/e.npz old/batch.jsonl old/f.npz".split():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    return tmp_path


def test_folders_are_looked_through(folder: Path) -> None:
    assert names(folder) == ["a.MOV", "b.mp4", "in/c.mcap"]
    found = find_recordings([str(folder)], folder / "out")
    assert found.passed_over == {"no ending": 1, ".mp4": 1, ".txt": 1}


def test_what_is_named_is_taken_whatever_it_is_called(folder: Path) -> None:
    assert names(folder, folder / "in" / "notes.txt", folder / "in") == [
        "in/notes.txt", "in/c.mcap",
    ]  # fmt: skip


def test_each_once(folder: Path) -> None:
    (folder / "in" / "link.mp4").symlink_to(folder / "b.mp4")
    (folder / "in" / "round").symlink_to(folder)
    found = find_recordings([str(folder / "b.mp4"), str(folder)], folder / "out")
    assert [Path(r.path).name for r in found.recordings] == ["b.mp4", "a.MOV", "c.mcap"]
    assert found.again == 2


def test_strange_names(tmp_path: Path) -> None:
    strange = ["a b.mp4", "new\nline.mp4", "<b>&.mp4", os.fsdecode(b"\xff.mp4")]
    for name in strange:
        (tmp_path / name).touch()
    assert sorted(names(tmp_path)) == sorted(strange)
    listed = b"\0".join(os.fsencode(tmp_path / name) for name in strange) + b"\0"
    assert read_list(listed, "-") == [str(tmp_path / name) for name in strange]


def test_a_folder_that_cannot_be_read_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scan = os.scandir

    def refusing(path: str) -> object:
        if path.endswith("in"):
            raise PermissionError(13, "Permission denied", path)
        return scan(path)

    monkeypatch.setattr(os, "scandir", refusing)
    found = find_recordings([str(folder)], folder / "out")
    assert found.unreadable == [f"{folder / 'in'}: Permission denied"]
    assert len(found.recordings) == 2


def test_results_are_no_input(folder: Path) -> None:
    assert names(folder, folder / "old") == []
    assert JOURNAL in os.listdir(folder / "old")


@pytest.mark.parametrize(
    ("data", "paths"),
    [(b"a\r\nb c\n\n", ["a", "b c"]), (b"a\nb\0c\0", ["a\nb", "c"]), (b"one", ["one"])],
)
def test_lists(
    data: bytes, paths: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(paths[0]).touch()  # the others may be gone: each is told of by itself
    assert read_list(data, "list") == paths


@pytest.mark.parametrize(
    ("data", "said"),
    [(b"", "not a"), (b"\n", "not a"), (b"a/" + b"x" * 300, "not a"), (b"a\nb", "'a'")],
)
def test_what_is_no_list(
    data: bytes, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=said):
        read_list(data, "list")
