"""What the verbs put on stdout: keys that stay, numbers that JSON knows, nothing else."""

from __future__ import annotations

import itertools
import json
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsenf.cli import console, main
from tests.hidden_clip import HiddenClip

Rsenf = Callable[..., subprocess.CompletedProcess[str]]


def strict(text: str) -> Any:
    """Parse JSON as the standard has it: no NaN, no Infinity; ns only as strings."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    def check(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        assert not [k for k, v in pairs if k.endswith("_ns") and not isinstance(v, str)]
        return dict(pairs)

    return json.loads(text, parse_constant=refuse, object_pairs_hook=check)


@pytest.mark.parametrize(
    ("method", "first_s", "values"), [("stft", 10.0, 26), ("projection", 0.5, 45)]
)
def test_track_gives_one_value_a_second(
    rsenf: Rsenf, clip: Path, method: str, first_s: float, values: int
) -> None:
    done = rsenf("track", clip, "--json", "--method", method)
    assert done.returncode == 0
    lines = [strict(line) for line in done.stdout.splitlines()]
    assert [line["t_s"] for line in lines] == [first_s + k for k in range(values)]
    truth = json.loads(clip.with_suffix(".truth.json").read_text())
    middle = np.interp([line["t_s"] for line in lines], truth["t_s"], truth["enf_hz"])
    for line, true_hz in zip(lines, middle, strict=True):
        assert {"t_s", "enf_hz", "enf_std_hz", "snr_db", "usable"} <= line.keys()
        assert line["usable"] is True
        assert abs(line["enf_hz"] - true_hz) < 4 * line["enf_std_hz"]
        assert line["snr_db"] > 20.0
    assert done.stderr.startswith(f"note: {values} of {values} values usable; 50 Hz grid, ")


def test_a_line_is_no_use_to_a_method_that_follows_all(rsenf: Rsenf, clip: Path) -> None:
    for words in (("--line", "0"), ("--harmonic", "2")):
        done = rsenf("track", clip, "--method", "projection", *words)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(f"rsenf: projection takes no {words[0][2:]}: follows")


def test_track_in_a_table(rsenf: Rsenf, clip: Path) -> None:
    head, *rows = rsenf("track", clip).stdout.splitlines()
    lines = [strict(line) for line in rsenf("track", clip, "--json").stdout.splitlines()]
    assert head.split() == ["t", "(s)", "ENF", "(Hz)", "±", "mHz", "SNR", "(dB)"]
    assert [float(row.split()[1]) for row in rows] == [round(x["enf_hz"], 5) for x in lines]


def test_track_prints_values_as_they_come(
    hidden: HiddenClip, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    printed = [0]

    @contextmanager
    def watched(*_: object, **__: object) -> Iterator[Callable[[float], None]]:
        yield lambda _: printed.append(printed[-1] + capsys.readouterr().out.count("\n"))

    monkeypatch.setattr(console, "progress_bar", watched)
    assert main(["track", str(hidden.clip), "--json"]) == 0
    last = len(capsys.readouterr().out.splitlines())
    assert len(set(printed)) > last  # most of them before the end of the recording


def test_seconds_without_a_signal_are_lines_too(rsenf: Rsenf, tmp_path: Path) -> None:
    noise = np.random.default_rng(2).normal(100.0, 1.0, 900)
    np.savez(tmp_path / "noise.npz", luminance=noise, frame_rate_hz=30.0)
    done = rsenf("track", tmp_path / "noise.npz", "--json", "--method", "stft")
    lines = [strict(line) for line in done.stdout.splitlines()]
    assert [line["t_s"] for line in lines] == [10.0 + k for k in range(11)]
    assert {(line["enf_hz"], line["usable"]) for line in lines} == {(None, False)}
    assert all(line["reason"] for line in lines)
    assert done.stderr.startswith(f"rsenf: {tmp_path / 'noise.npz'}: no usable signal in 30 s")


@pytest.fixture(scope="module")
def verdict(rsenf: Rsenf, hidden: HiddenClip) -> dict[str, Any]:
    done = rsenf("verify", hidden.clip, "--reference", hidden.reference, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    return strict(done.stdout)  # type: ignore[no-any-return]


def test_verify_finds_the_second(verdict: dict[str, Any], hidden: HiddenClip) -> None:
    assert verdict["decision"] == "match"
    assert verdict["lag_s"] == pytest.approx(hidden.lag_s, abs=1.0)
    assert abs(verdict["lag_s"] - hidden.lag_s) < 5 * verdict["lag_std_s"] + 0.05
    assert verdict["start_utc"][:19] in ("2024-03-01T10:39:05", "2024-03-01T10:39:06")
    assert verdict["start_utc"].endswith("Z")
    assert 0.98 < verdict["correlation"] <= 1.0
    assert verdict["log10_lr"] > 2.0
    assert verdict["log10_lr_absent"] > 0.0
    assert verdict["verbal"].endswith("support for this time")
    assert abs(verdict["clock_ppm"]) < 3.0
    assert 7000 < verdict["search_size"] < 7400


def test_verify_s_keys_stay(verdict: dict[str, Any]) -> None:
    assert {
        "decision", "lag_s", "lag_std_s", "start_utc", "correlation", "log10_lr", "claim",
        "verbal", "clock_ppm", "search_size", "idle_ratio", "method", "candidates", "warnings",
    } <= verdict.keys()  # fmt: skip
    assert verdict["claim"] is None
    assert verdict["idle_ratio"] is None
    assert verdict["method"] == "phase"
    assert verdict["warnings"] == []
    first, *others = verdict["candidates"]
    assert first["lag_s"] == verdict["lag_s"]
    assert others
    assert all(c["log10_lr"] < 0 for c in others)


def test_verify_in_words(rsenf: Rsenf, hidden: HiddenClip, verdict: dict[str, Any]) -> None:
    done = rsenf("verify", hidden.clip, "--reference", hidden.reference)
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"match: the recording begins {verdict['start_utc']}, 2345.")
    assert len(lines) <= 10
    assert max(map(len, lines)) <= 100
    assert any(verdict["verbal"] in line for line in lines)


@pytest.mark.parametrize(
    ("start", "claim", "says"),
    [
        ("2024-03-01T10:39:05Z", "supported", ""),
        ("2024-03-01T10:39:05.4", "supported", ""),
        ("2024-03-01T11:39:05.4+01:00", "supported", ""),
        ("2024-03-01T10:41:00Z", "refuted", ""),
        ("2024-03-01T11:39:05.4", "refuted", "the claim is off by just -1 h"),
        ("2023-01-01", "refuted", ""),
    ],
)
def test_a_claimed_start(
    rsenf: Rsenf, hidden: HiddenClip, start: str, claim: str, says: str
) -> None:
    words = ["verify", hidden.clip, "--reference", hidden.reference, "--start", start]
    done = rsenf(*words, "--json")
    result = strict(done.stdout)
    assert result["claim"] == claim
    assert says in " ".join(result["warnings"])


def test_a_claim_is_said_in_words(rsenf: Rsenf, hidden: HiddenClip) -> None:
    words = ["verify", hidden.clip, "--reference", hidden.reference]
    done = rsenf(*words, "--start", "2024-03-01T10:41:00Z")
    assert done.stdout.splitlines()[-1].split() == [
        "claimed", "start", "2024-03-01T10:41:00.000Z:", "refuted",
    ]  # fmt: skip


def test_a_claim_that_can_t_be_tested(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    untimed = tmp_path / "untimed.csv"
    rows = hidden.reference.read_text().splitlines()[1:]
    untimed.write_text("\n".join(row.split(",")[1] for row in rows))
    words = ["verify", hidden.clip, "--reference", untimed, "--step-s", "1"]
    done = rsenf(*words, "--start", "2024-03-01T10:39:05Z", "--json")
    result = strict(done.stdout)
    assert (result["decision"], result["claim"]) == ("match", "undecidable")
    assert result["start_utc"] is None
    assert any("claim can't be tested" in line for line in result["warnings"])


def test_a_claim_about_too_little_is_undecidable(
    rsenf: Rsenf, hidden: HiddenClip, clip: Path
) -> None:
    words = ["verify", clip, "--reference", hidden.reference, "--start", "2024-03-01T10:39:05Z",
             "--enf-method", "stft"]  # fmt: skip
    result = strict(rsenf(*words, "--json").stdout)  # 26 values: each needs 20 s of the 45
    assert (result["decision"], result["claim"]) == ("no_decision", "undecidable")
    assert result["lag_s"] is None
    assert result["correlation"] is None


def test_simulate_s_keys_stay(rsenf: Rsenf, hidden: HiddenClip, tmp_path: Path) -> None:
    out = tmp_path / "x.mp4"
    done = rsenf(
        "simulate", "--out", out, "--reference", hidden.reference, "--start-s", "100.5",
        "--duration-s", "3", "--seed", "7", "--bitrate", "150k", "--size", "160x120", "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = strict(done.stdout)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["x.mp4", "x.truth.json"]
    truth = strict(Path(result["truth"]).read_text())
    assert {
        "idle_ratio", "read_out_time_s", "t_s", "enf_hz", "reference_start_s", "clock_ppm",
        "effects",
    } <= truth.keys()  # fmt: skip
    assert truth["reference_start_s"] == 100.5
    assert truth["t_s"] == [0.5, 1.5, 2.5]
    reference = [float(x.split(",")[1]) for x in hidden.reference.read_text().splitlines()[1:]]
    halves = [(a + b) / 2 for a, b in itertools.pairwise(reference[100:104])]
    assert truth["enf_hz"] == pytest.approx(halves, abs=5e-4)


GRAPH = """\
version: 1
site: home
nodes:
  decode: {kind: decode, camera: door, input: "rtsp://admin:hunter2@10.0.0.7/cam"}
  rows:   {kind: rows, cameras: [door]}
"""


def test_validate(rsenf: Rsenf, tmp_path: Path) -> None:
    path = tmp_path / "graph.yaml"
    path.write_text(GRAPH)
    done = rsenf("validate", path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{path}: fine. Site 'home', 2 nodes:\n")
    as_json = rsenf("validate", path, "--json")
    assert "hunter2" not in as_json.stdout + done.stdout
    assert strict(as_json.stdout)["nodes"]["rows"]["kind"] == "rows"


def test_explain(rsenf: Rsenf, tmp_path: Path) -> None:
    assert "EnfEstimate" in rsenf("explain").stdout
    assert "enf_hz" in rsenf("explain", "EnfEstimate").stdout
    assert "130  interrupted" in rsenf("explain", "exit-codes").stdout
    assert rsenf("explain", "cusum").stdout.startswith("CUSUM: cumulative sum")
    assert "rsenf/<site>/<camera>/rows" in rsenf("explain", "keys").stdout
    done = rsenf("explain", "nonsense")
    assert (done.returncode, done.stdout) == (2, "")
    done = rsenf("explain", "schemas", "--out", tmp_path / "schema")
    written = {Path(line).name for line in done.stdout.splitlines()}
    assert written == {p.name for p in (tmp_path / "schema").iterdir()}
    assert written >= {"rsenf.proto", "rsenf.desc", "graph.schema.json", "verify.schema.json"}
    assert strict((tmp_path / "schema" / "graph.schema.json").read_text())["title"] == "Graph"
