"""Bad input: one clear line, the right exit code, no traceback, nothing half-written."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.bad_files import USELESS, cut, grey_video, repacked
from tests.hidden_clip import HiddenClip

Done = subprocess.CompletedProcess[str]
Rsenf = Callable[..., Done]
VERBS = ("track", "verify")


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten minutes of a reference without times."""
    path = tmp_path_factory.mktemp("grid") / "grid.csv"
    path.write_text("\n".join(f"{50 + 0.01 * (k % 17):.3f}" for k in range(600)))
    return path


def call(rsenf: Rsenf, verb: str, path: Path, grid: Path, *more: object) -> Done:
    """Call a verb; check what holds for every call, however bad its input."""
    before = sorted(path.parent.rglob("*")) if path.parent.is_dir() else []
    words = ["--reference", grid, "--step-s", "1"] if verb == "verify" else []
    done = rsenf(verb, path, *words, *more)
    assert "Traceback" not in done.stderr
    assert (sorted(path.parent.rglob("*")) if path.parent.is_dir() else []) == before
    return done


def line_of(done: Done) -> str:
    """The one line that says what is wrong; anything else on stderr is a note."""
    lines = done.stderr.splitlines()
    (line,) = [text for text in lines if text.startswith("rsenf: ")]
    assert all(text.startswith("note: ") for text in lines if text != line), done.stderr
    return line


def assert_refused(done: Done, code: int, name: str) -> str:
    assert (done.returncode, done.stdout) == (code, ""), done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr
    line = line_of(done)
    assert name in line
    assert line.endswith(")"), f"no hint what to do: {line}"
    return line


@pytest.mark.parametrize("verb", VERBS)
def test_a_missing_file(rsenf: Rsenf, verb: str, grid: Path, tmp_path: Path) -> None:
    done = call(rsenf, verb, tmp_path / "gone.mp4", grid)
    assert "no such file" in assert_refused(done, 2, "gone.mp4")


@pytest.mark.parametrize("verb", VERBS)
def test_a_folder(rsenf: Rsenf, verb: str, grid: Path, tmp_path: Path) -> None:
    (tmp_path / "trip").mkdir()
    done = call(rsenf, verb, tmp_path / "trip", grid)
    assert "is a folder" in assert_refused(done, 2, "trip")


def test_a_live_source_and_no_password(rsenf: Rsenf, grid: Path) -> None:
    camera = "rtsp://admin:hunter2@127.0.0.1:9/cam"
    for verb, words, code, says in (
        ("verify", ["--reference", grid, "--step-s", "1"], 2, "live source"),
        ("track", [], 1, "connection refused"),
    ):
        done = rsenf(verb, camera, *words)
        assert says in assert_refused(done, code, "rtsp://***@127.0.0.1:9/cam")
        assert "hunter2" not in done.stderr


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("name", USELESS)
def test_a_file_of_no_use(rsenf: Rsenf, verb: str, name: str, grid: Path, tmp_path: Path) -> None:
    USELESS[name](tmp_path / name)
    assert_refused(call(rsenf, verb, tmp_path / name, grid), 1, name)


@pytest.mark.parametrize("verb", VERBS)
def test_an_mp4_that_was_never_finished(
    rsenf: Rsenf, verb: str, clip: Path, grid: Path, tmp_path: Path
) -> None:
    path = cut(clip, tmp_path / "cut.mp4", 0.5)
    assert "moov" in assert_refused(call(rsenf, verb, path, grid), 1, "cut.mp4")


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("name", ["cut.mkv", "cut.mp4"])
def test_a_truncated_video_gives_what_is_there(
    rsenf: Rsenf, verb: str, name: str, clip: Path, grid: Path, tmp_path: Path
) -> None:
    whole = repacked(clip, tmp_path / f"whole-{name}", {"movflags": "faststart"})
    path = cut(whole, tmp_path / name, 0.8)
    done = call(rsenf, verb, path, grid)
    assert done.returncode == 3
    assert "cut short" in line_of(done)
    assert name in line_of(done)
    if verb == "track":
        first, *_, last = done.stdout.splitlines()[1:]
        # The centres of what the first and the last value cover, by whatever method.
        assert float(first.split()[0]) in (0.5, 10.0)
        assert 20.0 < float(last.split()[0]) < 36.0
    else:  # the clip is of another grid than this one
        assert done.stdout.startswith(("no_decision: ", "no_match: "))


@pytest.mark.parametrize("verb", VERBS)
def test_a_truncated_recording_gives_what_is_there(
    rsenf: Rsenf, verb: str, recording: Path, grid: Path, tmp_path: Path
) -> None:
    path = cut(recording, tmp_path / "cut.mcap", 0.8)
    done = call(rsenf, verb, path, grid)
    assert done.returncode == 3, done.stderr
    assert "cut short" in line_of(done)
    assert "cut.mcap" in line_of(done)
    assert done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_too_short_to_tell_is_a_result(rsenf: Rsenf, verb: str, grid: Path, tmp_path: Path) -> None:
    done = call(rsenf, verb, grey_video(tmp_path / "short.mp4", 10, 100), grid)
    assert done.returncode == 0
    assert "short.mp4: too short to tell: 0.3 s of video" in line_of(done)
    assert done.stdout.startswith("no_decision: " if verb == "verify" else "")


@pytest.mark.parametrize("verb", VERBS)
def test_an_all_black_video_is_a_result(
    rsenf: Rsenf, verb: str, grid: Path, tmp_path: Path
) -> None:
    done = call(rsenf, verb, grey_video(tmp_path / "night.mp4", 900, 16), grid)
    assert done.returncode == 0
    assert "night.mp4: no usable signal in 30 s of video: 100% of the rows are black" in line_of(
        done
    )
    if verb == "verify":
        assert done.stdout == "no_decision: no usable signal: too few frames are usable\n"


def test_a_recording_without_row_blocks(rsenf: Rsenf, grid: Path, tmp_path: Path) -> None:
    from rsenf.record.writer import Recorder

    path = tmp_path / "other.mcap"
    with Recorder(path, run_info={}, clock_ns=lambda: 1):
        pass
    assert_refused(call(rsenf, "track", path, grid), 1, "other.mcap")


REFERENCES = {
    "columns.csv": "time,voltage\n2024-01-01 00:00:00,230\n",
    "empty.csv": "",
    "untimed.csv": "frequency\n50.0\n50.01\n50.0\n",
    "brief.csv": "\n".join(["frequency", *["50.00"] * 40]),
    "text.csv": "It was a dark night.\nAnd stormy.\n",
    "binary.csv": "\0\0\0\0",
    "damaged.csv.gz": "\x1f\x8b and no more",
}


@pytest.mark.parametrize("name", REFERENCES)
def test_a_reference_of_no_use(rsenf: Rsenf, name: str, clip: Path, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(REFERENCES[name].encode("latin-1"))
    step = [] if name == "untimed.csv" else ["--step-s", "1"]
    done = rsenf("verify", clip, "--reference", path, *step)
    line = assert_refused(done, 2, name)
    if name == "brief.csv":
        assert "covers 40.0 s, less than the 45.0 s of" in line


def test_a_missing_reference(rsenf: Rsenf, clip: Path, tmp_path: Path) -> None:
    done = rsenf("verify", clip, "--reference", tmp_path / "gone.csv")
    assert_refused(done, 2, "gone.csv")


def test_a_reference_of_another_grid_is_a_result(
    rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path
) -> None:
    path = tmp_path / "us.csv"
    path.write_text("\n".join(f"{60 + 0.01 * (k % 17):.3f}" for k in range(600)))
    clip = hidden.clip
    done = rsenf("verify", clip, "--reference", path, "--step-s", "1", "--nominal-hz", "50")
    assert done.returncode == 0
    assert "a 50 Hz grid, the reference is of a 60 Hz one" in done.stdout


@pytest.mark.parametrize("verb", ["validate", "run"])
def test_a_graph_with_a_misspelled_key(rsenf: Rsenf, verb: str, tmp_path: Path) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(
        "version: 1\nsite: home\nnodes:\n"
        "  decode: {kind: decode, camera: cam1, input: clip.mp4}\n"
        "  rows:\n    kind: rows\n    camerass: [cam1]\n"
    )
    done = rsenf(verb, path)
    assert (done.returncode, done.stdout) == (2, "")
    assert f"rsenf: {path}:7: " in done.stderr
    assert "camerass" in done.stderr
    assert "cameras" in done.stderr.replace("camerass", "")
    assert all(line.startswith("rsenf: ") for line in done.stderr.splitlines())
    assert [p.name for p in tmp_path.iterdir()] == ["graph.yaml"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["--method", "magic"],
            "argument --method: no 'magic' (one of phase, ncc, metric1, metric2, metric3, metric4)",
        ),
        (["--enf-method", "magic"], "argument --enf-method: no 'magic' (one of "),
        (["--start", "yesterday"], "start 'yesterday' is not a time"),
        (["--step-s", "-1"], "a step of -1 s between samples"),
        (["--step-s", "nan"], "argument --step-s: nan is not a finite number"),
        (["--nominal-hz", "55"], "argument --nominal-hz: no 55.0 (one of 50.0, 60.0)"),
        (["--picture", "/no/such/folder/x.png"], "picture /no/such/folder/x.png: no such folder"),
        (["--timezone", "Mars/Olympus"], "Mars/Olympus"),
        (["--column", "watts"], "watts"),
    ],
)
def test_arguments_that_can_t_be_meant(
    rsenf: Rsenf, hidden: HiddenClip, words: list[str], says: str, tmp_path: Path
) -> None:
    path = tmp_path / "grid.csv"
    path.write_text(hidden.reference.read_text().replace("Z,", ","))
    done = rsenf("verify", hidden.clip, "--reference", path, *words)
    assert says in assert_refused(done, 2, "")


@pytest.mark.parametrize(
    "words",
    [["--duration-s", "0"], ["--duration-s", "nan"], ["--duration-s", "-5"], ["--seed", "-1"]],
)
def test_simulated_clips_that_can_t_be_meant(
    rsenf: Rsenf, words: list[str], tmp_path: Path
) -> None:
    assert_refused(rsenf("simulate", "--out", tmp_path / "x.mp4", *words), 2, words[0])
    assert list(tmp_path.iterdir()) == []
