"""Commands of the README and the pages of help are run, in order, in one folder, as by a reader."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.conftest import ROOT
from tests.readme import README, blocks, pages

# Run by .ci/run, which builds the environments that they describe.
BY_CI = {"demo", "test"}


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like the checkout, with the demo made, and the README's own files in it."""
    folder = tmp_path_factory.mktemp("reader")
    shutil.copytree(ROOT / "configs", folder / "configs")
    text = "".join(page.read_text(encoding="utf-8") for page in pages())
    for name, body in re.findall(r"<!-- file: (\S+) -->\n```(?:python|toml)\n(.*?)```", text, re.S):
        (folder / name).write_text(body, encoding="utf-8")
    install(folder)
    run("rsenf demo", folder)
    return folder


def install(folder: Path) -> None:
    """Make the README's package known to whoever has its folder on the path."""
    told = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    facts = folder / f"{told['name'].replace('-', '_')}-{told['version']}.dist-info"
    facts.mkdir()
    about = f"Metadata-Version: 2.1\nName: {told['name']}\nVersion: {told['version']}\n"
    (facts / "METADATA").write_text(about, encoding="utf-8")
    lines = [
        line
        for group, names in told["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {where}" for name, where in names.items()))
    ]
    (facts / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(folder)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    # `head` closes the pipe early: that is not the command's failure.
    assert done.returncode in ((0, 1) if "| head" in command else (0,)), done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.processes
@pytest.mark.parametrize(
    ("place", "command"),
    [
        (block.place, command)
        for block in blocks()
        if block.name not in {*BY_CI, "not-run"}
        for command in block.commands
    ],
)
def test_command(place: str, command: str, reader: Path) -> None:
    done = run(command, reader)
    if "listen.py" in command:
        assert done.stdout.count(" Hz") >= 5, done.stdout


def test_no_command_waits_for_seconds_or_forgets_what_it_starts() -> None:
    """What runs beside is waited for by its number: so its failure is the command's."""
    for command in (command for block in blocks() for command in block.commands):
        assert "sleep " not in command
        assert not re.search(r"[^&]&(?!&)", command) or command.endswith("wait $!"), command


def test_the_two_commands_are_there() -> None:
    assert {"demo", "test"} <= {block.name for block in blocks()}
    assert all(len(b.commands) == 1 for b in blocks() if b.name in BY_CI)


def test_every_file_that_is_named_exists() -> None:
    for page in pages():
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(((?!https?:)[^)#]+)\)", text):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_place_in_a_page_that_is_named_exists() -> None:
    for page in pages():
        text = page.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(#([^)]+)\)", text):
            titles = re.findall(r"^#+ (.*)", text, re.M)
            assert target in {
                re.sub(r"[^a-z0-9 -]", "", t.lower()).replace(" ", "-") for t in titles
            }


def test_the_pages_are_those_that_there_are() -> None:
    assert {page.name for page in pages()[1:]} == {
        p.name for p in (ROOT / "rsenf/help").glob("*.md")
    }


def test_people_finish_the_readme() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 300
