"""The version of rsenf, and the commit that it was built from or is checked out at."""

from __future__ import annotations

from pathlib import Path
from typing import Any

BUILT_FROM = "COMMIT"  # file in the package, written at build time
SHOWN = 12  # digits


def version_text() -> str:
    """Return the output of ``rsenf --version``."""
    from rsenf import __version__

    found, _ = commit()
    return f"rsenf {__version__}" + (f" (commit {found[:SHOWN]})" if found else "")


def commit() -> tuple[str, bool]:
    """Return the commit ('' if unknown), and whether it is that of a built package."""
    package = Path(__file__).parent
    built_from = package / BUILT_FROM
    is_built = built_from.is_file()
    return built_from.read_text() if is_built else commit_of(package.parent), is_built


def commit_of(checkout: Path) -> str:
    """Return the commit that a folder is checked out at, read without git; '' if unknown."""
    git = checkout / ".git"
    if git.is_file():  # in a worktree
        git = checkout / git.read_text().removeprefix("gitdir:").strip()
    try:
        head = (git / "HEAD").read_text().strip()
        shared = git / "commondir"
        refs = git / shared.read_text().strip() if shared.is_file() else git
        ref = head.removeprefix("ref: ")
        if ref == head:
            return head
        if (refs / ref).is_file():
            return (refs / ref).read_text().strip()
        packed = (line.split() for line in (refs / "packed-refs").read_text().splitlines())
        return next((words[0] for words in packed if words[1:] == [ref]), "")
    except OSError:
        return ""


def __getattr__(name: str) -> Any:
    """Return ``BuildPy``, which also writes the commit; lazily, as users may lack setuptools."""
    if name != "BuildPy":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from setuptools.command.build_py import build_py

    class BuildPy(build_py):  # type: ignore[misc] # setuptools has no types
        def run(self) -> None:
            super().run()
            if not self.editable_mode:
                built = Path(self.build_lib) / "rsenf" / BUILT_FROM
                built.write_text(commit_of(Path.cwd()))

    return BuildPy
