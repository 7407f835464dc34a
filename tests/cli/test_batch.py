"""``rsenf batch``: each recording ends with a result or a reason, once; stopping costs none."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest

from rsenf.batch.journal import Journal
from rsenf.cli import main
from tests.hidden_clip import HiddenClip

STRANGE = "<b>&\n two.npz"


def table(out: Path) -> dict[str, dict[str, Any]]:
    """Rows of the table by the names of their recordings, each of which is there once."""
    rows = pyarrow.parquet.read_table(out / "batch.parquet").to_pylist()
    found = {Path(row["path"]).name: row for row in rows}
    assert len(found) == len(rows)
    return found


def dark(path: Path, seconds: int = 6) -> None:
    """Rows without any light."""
    frames = 25 * seconds
    rows = np.random.default_rng(1).normal(100.0, 0.1, (frames, 24)).astype(np.float32)
    np.savez(path, rows=rows, frame_time_s=np.arange(frames) / 25.0)


@pytest.fixture(scope="module")
def folder(hidden: HiddenClip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip, twice and by a link; darkness; what is no recording at all."""
    folder = tmp_path_factory.mktemp("many recordings")
    shutil.copy(hidden.clip, folder / "one.npz")
    dark(folder / STRANGE, 3)
    (folder / "same.npz").symlink_to("one.npz")
    (folder / "in").mkdir()
    dark(folder / "in" / "dark.npz")
    (folder / "empty.mp4").touch()
    (folder / "text.mp4").write_text("This is no video.\n")
    (folder / "notes.txt").write_text("nor is this\n")
    return folder


@pytest.mark.processes
def test_all_end_and_the_next_run_goes_on(
    folder: Path, hidden: HiddenClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "out"
    words = ["batch", "verify", str(folder), "--reference", str(hidden.reference), "--out",
             str(out), "--jobs", "2", "--json"]  # fmt: skip
    assert main(words) == 1
    told = capsys.readouterr()
    assert told.err.startswith("rsenf: recordings to do: 5 of 5\n")
    assert f"\nrsenf: unusable: {folder / 'text.mp4'}: is not a video" in told.err
    summary = json.loads(told.out)
    assert [summary[s] for s in ("done", "no_signal", "unusable", "failed")] == [1, 2, 2, 0]
    assert (summary["verdicts"], summary["named_again"]) == ({"match": 1}, 1)
    assert summary["passed_over"] == {".txt": 1}

    rows = table(out)
    assert sorted(rows) == sorted(["one.npz", STRANGE, "dark.npz", "empty.mp4", "text.mp4"])
    match = rows["one.npz"]
    assert match["lag_s"] == pytest.approx(hidden.lag_s, abs=1.0)
    assert 0.0 < match["lag_std_s"] < 1.0
    assert len(match["sha256"]) == 64
    assert rows["dark.npz"]["status"] == "no_signal"
    assert rows["dark.npz"]["reason"] == "no usable signal: no mains flicker stands out"
    assert rows["text.mp4"]["reason"].startswith("is not a video that can be read (")
    page = (out / "batch.html").read_text()
    assert "&lt;b&gt;&amp;" in page
    assert "<b>&" not in page
    assert "http" not in page.replace("http-equiv", "")

    # What is mended is done, and what is as it was isn't done again, be it of use or not.
    journal = (out / "batch.jsonl").read_bytes()
    assert main(words) == 1
    unchanged = "unusable before, and unchanged: 2 (--retry does them again)"
    assert f"recordings to do: 0 of 5; {unchanged}\n" in capsys.readouterr().err
    assert (out / "batch.jsonl").read_bytes() == journal
    (folder / "text.mp4").unlink()
    (folder / "empty.mp4").unlink()
    dark(folder / "mended.npz")
    assert main(words) == 0
    assert "recordings to do: 1 of 4\n" in capsys.readouterr().err
    assert (out / "batch.jsonl").read_bytes().startswith(journal)
    assert sorted(table(out)) == sorted(["one.npz", STRANGE, "dark.npz", "mended.npz"])
    assert table(out)["one.npz"] == match

    assert main(["batch", "idle", str(folder), "--out", str(out)]) == 2
    assert "holds results of 'verify'" in capsys.readouterr().err

    dark(folder / "mended.npz", 7)
    assert main(words) == 0
    assert "to do: 1 of 4 (0 new, 1 changed since)\n" in capsys.readouterr().err


@pytest.mark.processes
def test_the_same_as_the_verbs_for_one(
    hidden: HiddenClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.npz"
    with np.load(hidden.clip) as whole:
        np.savez(clip, **{name: whole[name][:900] for name in ("rows", "frame_time_s")})
    for verb in ("track", "idle"):
        assert main(["batch", verb, str(clip), "--out", str(tmp_path / verb)]) == 0
        capsys.readouterr()
        assert main([verb, str(clip), "--json"]) == 0
        alone = capsys.readouterr().out
        (row,) = table(tmp_path / verb).values()
        if verb == "track":
            assert (tmp_path / verb / row["enf_file"]).read_text() == alone
            values = [v["enf_hz"] for v in map(json.loads, alone.splitlines()) if v["usable"]]
            assert row["usable_values"] == len(values)
            assert row["enf_mean_hz"] == pytest.approx(np.mean(values), abs=1e-9)
        else:
            told = json.loads(alone)
            # The table has no columns for them.
            beside = ("warnings", "reason", "converted", "slips", "rate_hypotheses")
            assert {k: row[k] for k in told if k not in beside} == {
                k: told[k] for k in told if k not in beside
            }


# Kills itself, as a crash of the decoder would, while it reads the recording that is named so.
DEADLY = """
import os, signal, sys
from rsenf.cli import main
from rsenf.run import inputs

whole = inputs.Luminance.messages

def deadly(self):
    if "deadly" in self.name:
        os.kill(os.getpid(), signal.SIGKILL)
    if "slow" in self.name:
        import time
        time.sleep(3600)
    return whole(self)

inputs.Luminance.messages = deadly
if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
"""


def batch(folder: Path, *words: str) -> subprocess.Popen[str]:
    script = folder / "deadly.py"
    script.write_text(DEADLY)
    command = [sys.executable, str(script), "batch", *words]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )


@pytest.mark.processes
def test_a_crash_costs_one_recording(tmp_path: Path) -> None:
    for name in ("a.npz", "deadly.npz", "z.npz"):
        dark(tmp_path / name, 3)
    out = tmp_path / "out"
    with batch(tmp_path, "idle", str(tmp_path), "--out", str(out), "--jobs", "1") as run:
        _, told = run.communicate()
    assert run.returncode == 1
    reason = "the process that worked on it was ended by SIGKILL"
    assert told.endswith(f"rsenf: failed: {tmp_path / 'deadly.npz'}: {reason}\n")
    rows = table(out)
    assert {name: row["status"] for name, row in rows.items()} == {
        "a.npz": "no_signal", "deadly.npz": "failed", "z.npz": "no_signal",
    }  # fmt: skip
    assert rows["deadly.npz"]["tries"] == 2


@pytest.mark.processes
def test_interrupted_it_keeps_what_is_done(tmp_path: Path) -> None:
    for name in ("a.npz", "slow.npz"):
        dark(tmp_path / name, 3)
    journal = tmp_path / "out" / "batch.jsonl"
    with batch(tmp_path, "idle", str(tmp_path), "--out", str(journal.parent), "--jobs", "1") as run:
        while not (journal.exists() and journal.read_bytes()):
            assert run.poll() is None
            time.sleep(0.02)
        os.killpg(run.pid, signal.SIGINT)  # as a terminal does, to all of its processes
        out, told = run.communicate()
    assert (run.returncode, out) == (130, "")
    assert told.splitlines()[1:] == [
        f"rsenf: what is done is kept in {journal}; the same command goes on from there",
        "rsenf: interrupted",
    ]
    assert journal.read_bytes().count(b"\n") == 1
    assert [path.name for path in journal.parent.iterdir()] == ["batch.jsonl"]


def test_two_at_once_are_refused(
    hidden: HiddenClip, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Journal(tmp_path / "batch.jsonl"):
        assert main(["batch", "idle", str(hidden.clip), "--out", str(tmp_path)]) == 2
    assert "another run is writing it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["idle", "gone.mp4"], "gone.mp4: no such file or folder"),
        (["idle"], "no recordings are named"),
        (["idle", "nothing"], "no recordings in nothing"),
        (["idle", "out"], "--out out is the folder that is to be read"),
        (["idle", "--list", "gone"], "--list gone: No such file"),
        (["idle", "clip.npz", "--method", "magic"], "no 'magic'"),
        (["track", "clip.npz", "--method", "magic"], "no 'magic'"),
        (["verify", "clip.npz"], "required: --reference"),
        (["verify", "clip.npz", "--reference", "gone.csv"], "gone.csv"),
        (["simulate", "clip.npz"], "no 'simulate'"),
    ],
)
def test_what_cannot_be_meant_is_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "nothing").mkdir()
    if "out" in words:
        (tmp_path / "out").mkdir()
    (tmp_path / "clip.npz").touch()
    assert main(["batch", *words, "--out", "out"]) == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert said in told.err
    assert not (tmp_path / "out" / "batch.jsonl").exists()
