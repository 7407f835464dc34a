"""The commit of a checkout, however git keeps it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from rsenf import __version__
from rsenf.cli import main
from rsenf.version import commit_of
from tests.conftest import ROOT

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


def git(folder: Path, *words: str) -> str:
    who = ["-c", "user.name=x", "-c", "user.email=x@example.com"]
    done = subprocess.run(
        ["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    folder = tmp_path / "checkout"
    folder.mkdir()
    git(folder, "init", "--quiet")
    for number in range(2):
        git(folder, "commit", "--quiet", "--allow-empty", "--message", str(number))
    return folder


def test_it_is_what_git_says(checkout: Path) -> None:
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")
    git(checkout, "pack-refs", "--all")
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")
    git(checkout, "checkout", "--quiet", "--detach", "HEAD~1")
    assert commit_of(checkout) == git(checkout, "rev-parse", "HEAD")


def test_of_a_worktree_too(checkout: Path, tmp_path: Path) -> None:
    beside = tmp_path / "beside"
    git(checkout, "worktree", "add", "--quiet", "-b", "other", str(beside), "HEAD~1")
    assert commit_of(beside) == git(beside, "rev-parse", "HEAD") != commit_of(checkout)


def test_what_is_no_checkout_has_none(checkout: Path, tmp_path: Path) -> None:
    assert commit_of(tmp_path) == ""
    git(checkout, "checkout", "--quiet", "--orphan", "empty")
    assert commit_of(checkout) == ""


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="this is no checkout")
def test_the_command_says_version_and_commit(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    said = capsys.readouterr().out
    assert said == f"rsenf {__version__} (commit {git(ROOT, 'rev-parse', 'HEAD')[:12]})\n"
