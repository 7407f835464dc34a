"""The command line as such: help, verbs, streams, colours; no verb's own work."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rsenf.cli import GROUPS, VERBS, main
from rsenf.version import version_text
from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]
HEAVY = (
    "numpy",
    "scipy",
    "av",
    "zenoh",
    "cv2",
    "matplotlib",
    "pydantic",
    "yaml",
    "rich",
    "mcap",
    "pyarrow",
)
# SGR sequences that choose a colour, rather than bold or plain.
COLOUR = re.compile(r"\x1b\[[0-9;]*\b(3[0-8]|4[0-8]|9[0-7]|10[0-7])[0-9;]*m")


def modules_after(words: list[str]) -> set[str]:
    """Top-level modules that a call has imported."""
    code = (
        f"import sys; from rsenf.cli import main; main({words!r}); "
        "print(*{m.split('.')[0] for m in sys.modules}, file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


@pytest.mark.parametrize("words", [["--version"], ["--help"], [], ["verfy"]], ids=" ".join)
def test_help_imports_nothing_heavy(words: list[str]) -> None:
    seen = modules_after(words)
    assert not seen & set(HEAVY)
    assert "importlib.metadata" not in seen  # what other packages add is looked for later


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_a_verb_opens_no_codec_and_no_bus(verb: str) -> None:
    assert not modules_after(["help", verb]) & {"scipy", "av", "zenoh", "cv2", "matplotlib"}


def test_imports_that_are_there_are_seen() -> None:
    assert "numpy" in modules_after(["explain", "EnfEstimate"])


def test_version(rsenf: Rsenf) -> None:
    done = rsenf("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{version_text()}\n", "")


def test_help_names_every_verb(rsenf: Rsenf) -> None:
    done = rsenf("--help")
    assert (done.returncode, done.stderr) == (0, "")
    for group, verbs in GROUPS.items():
        listed = done.stdout.split(f"\n{group}:\n")[1].split("\n\n")[0]
        assert re.findall(r"^  ([\w-]+)", listed, re.MULTILINE) == list(verbs)
    assert rsenf().stdout == done.stdout
    assert rsenf("help").stdout == done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, "--help"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"usage: rsenf {verb} ")
    assert err == ""
    assert main(["help", verb]) == 0
    assert capsys.readouterr().out == out


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("verfy", "verify"), ("simualte", "simulate"), ("trak", "track"), ("Demo", "demo")],
)
def test_a_mistyped_verb_gets_the_nearest(rsenf: Rsenf, typed: str, meant: str) -> None:
    done = rsenf(typed, "clip.mp4")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"rsenf: no verb {typed!r}: did you mean '{meant}'?\n"


def test_a_verb_like_no_other(rsenf: Rsenf) -> None:
    assert rsenf("xyzzy").stderr == "rsenf: no verb 'xyzzy': see 'rsenf --help'\n"


@pytest.mark.parametrize(
    "words", [["--bogus"], ["track"], ["track", "clip.mp4", "--bogus"], ["demo", "--seed", "x"]]
)
def test_a_wrong_option_is_one_line(rsenf: Rsenf, words: list[str]) -> None:
    done = rsenf(*words)
    assert (done.returncode, done.stdout) == (2, "")
    assert re.fullmatch(r"rsenf: .*\(see 'rsenf.* --help'\)\n", done.stderr)


@pytest.mark.parametrize(
    "words",
    [["--debug", "track", "gone.mp4"], ["track", "--debug", "gone.mp4"],
     ["track", "gone.mp4", "--debug"]],
)  # fmt: skip
def test_debug_shows_the_traceback_wherever_it_stands(rsenf: Rsenf, words: list[str]) -> None:
    done = rsenf(*words)
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "UsageError: gone.mp4: no such file" in done.stderr


def test_the_console_script_and_the_module_are_the_same(rsenf: Rsenf) -> None:
    script = Path(sys.executable).with_name("rsenf")
    if not script.exists():
        pytest.skip("the package isn't installed beside this Python")
    for words in (["--help"], ["track", "gone.mp4"]):
        done = subprocess.run([script, *words], capture_output=True, text=True, check=False)
        twin = rsenf(*words)
        assert (done.returncode, done.stdout, done.stderr) == (
            twin.returncode, twin.stdout, twin.stderr,
        )  # fmt: skip


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["explain", "keys"], ["track"]])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_gone_is_no_traceback(
    words: list[str], unbuffered: str, hidden: HiddenClip
) -> None:
    """As in ``rsenf track … | head``, with a pipe that is closed before anything is written."""
    if words == ["track"]:
        words = ["track", str(hidden.clip), "--json"]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [sys.executable, "-m", "rsenf.cli", *words],
        stdout=writer, stderr=subprocess.PIPE, text=True, check=False,
        env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
    )  # fmt: skip
    os.close(writer)
    assert done.returncode in (0, 1)  # argparse doesn't mind that nobody reads its help
    assert [line for line in done.stderr.splitlines() if not line.startswith("note: ")] == []


def test_a_full_disk_under_stdout_is_one_line() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "rsenf.cli", "explain", "keys"],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (1, "rsenf: No space left on device\n")


def test_a_terminal_without_plus_minus(rsenf: Rsenf, hidden: HiddenClip) -> None:
    clip = hidden.clip
    done = rsenf("track", clip, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    assert done.stdout.startswith(" t (s)   ENF (Hz)   \\xb1 mHz")


def on_a_terminal(words: list[str], **environment: str) -> tuple[str, str]:
    """Run with stderr on a terminal; return stdout and what the terminal got."""
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-m", "rsenf.cli", *words],
        stdout=subprocess.PIPE, stderr=theirs, text=True,
        env={**os.environ, "TERM": "xterm-256color", **environment},
    ) as process:  # fmt: skip
        os.close(theirs)
        seen = b""
        while chunk := _read(ours):
            seen += chunk
        assert process.stdout is not None
        out = process.stdout.read()
    os.close(ours)
    assert process.returncode == 0, seen
    return out, seen.decode()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # Linux says so when the other side has closed
        return b""


def test_the_bar_is_on_a_terminal_only_and_colours_can_be_refused(rsenf: Rsenf, clip: Path) -> None:
    words = ["track", str(clip), "--json"]
    plain = rsenf(*words)
    assert "\x1b" not in plain.stdout + plain.stderr
    environment = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
    assert environment == dict(os.environ), "unset NO_COLOR and FORCE_COLOR for this test"
    out, seen = on_a_terminal(words)
    assert out == plain.stdout
    assert "tracking" in seen
    assert COLOUR.search(seen)
    out, seen = on_a_terminal(words, NO_COLOR="1")
    assert out == plain.stdout
    assert "tracking" in seen
    assert not COLOUR.search(seen)
