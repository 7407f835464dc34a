from __future__ import annotations

import argparse
import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest

from rsenf.cli import simulate
from rsenf.errors import ConfigError, UsageError
from rsenf.model import CATALOGUE, GridPath
from rsenf.record import open_recording

SMALL = ["--size", "160x120", "--duration-s", "3"]


def run(*options: object) -> int:
    parser = argparse.ArgumentParser()
    simulate.add_simulate(parser)
    return simulate.run_simulate(parser.parse_args([str(o) for o in options]))


def test_a_video_and_its_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "clip.mp4"
    code = run("--out", out, *SMALL, "--seed", 4, "--idle-ratio", 0.25, "--clock-ppm", 40, "--json")
    assert code == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["clip.mp4", "clip.truth.json"]
    result = json.loads(capsys.readouterr().out)
    truth = json.loads((tmp_path / "clip.truth.json").read_text())
    assert result["out"] == str(out)
    assert result["truth"] == str(tmp_path / "clip.truth.json")
    assert result["frames"] == truth["frames"] == 90
    assert truth["duration_s"] == pytest.approx(90 * 1001 / 30000)
    assert truth["idle_ratio"] == 0.25
    assert truth["read_out_time_s"] == pytest.approx(0.75 * 1001 / 30000)
    assert truth["clock_ppm"] == 40.0
    assert truth["reference_start_s"] == 0.0
    assert truth["seed"] == 4
    assert truth["t_s"] == [0.5, 1.5, 2.5]
    assert len(truth["enf_hz"]) == 3
    assert "true seconds" in truth["t_s_clock"]
    assert {"name": "clock_skew", "parameters": {"clock_ppm": 40.0}} in truth["effects"]
    assert truth["model"]["version"] == 2
    assert truth["files"] == [{"name": "clip.mp4", "codec": truth["model"]["codec"]}]


def test_rows_and_their_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "clip.npz"
    run("--out", out, *SMALL, "--strips", 2, "--frame-rate", "25", "--lamp", "cfl")
    with np.load(out) as data:
        assert data["rows"].shape == (75, 120, 2)
        assert data["rows"].dtype == np.float32
        assert data["frame_time_s"] == pytest.approx(np.arange(75) / 25)
    assert "75 frames" in capsys.readouterr().out


def test_a_recording_of_row_blocks(tmp_path: Path) -> None:
    clip = ["--seed", 3, "--strips", 2, "--effect", "frame_drop:at_frames=[20],retimed=false"]
    run("--out", tmp_path / "clip.npz", *SMALL, *clip)
    run("--out", tmp_path / "clip.mcap", *SMALL, *clip, "--site", "lab", "--camera", "left")
    recording = open_recording(tmp_path / "clip.mcap")
    assert list(recording.topics) == ["rsenf/lab/left/rows"]
    blocks = [message for _, message, _ in recording.messages()]
    with np.load(tmp_path / "clip.npz") as data:
        assert np.array_equal(np.concatenate([b.level for b in blocks]), data["rows"])
        times_s = np.concatenate([b.frame_pts_ns for b in blocks]) / 1e9
        assert times_s == pytest.approx(data["frame_time_s"], abs=1e-9)
    assert {b.read_out_axis for b in blocks} == {"rows"}
    assert json.loads((tmp_path / "clip.truth.json").read_text())["dropped_frames"] == [20]


def test_several_encodings_of_one_clip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "clip.mkv"
    code = run("--out", out, *SMALL, "--encodings", "lossless,150k,50k", "--json")
    assert code == 0
    names = ["clip.lossless.mkv", "clip.150k.mkv", "clip.50k.mkv"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*names, "clip.truth.json"])
    files = json.loads((tmp_path / "clip.truth.json").read_text())["files"]
    assert [f["name"] for f in files] == names
    assert [f["codec"]["lossless"] for f in files] == [True, False, False]
    assert [f["codec"]["bitrate_bps"] for f in files] == [None, 150_000, 50_000]
    assert [f["name"] for f in json.loads(capsys.readouterr().out)["files"]] == names
    run("--out", tmp_path / "alone.mkv", *SMALL, "--bitrate", "50k")
    # The same frames went to each encoder: coded alone, the clip has the same pictures.
    assert _packets(tmp_path / "alone.mkv") == _packets(tmp_path / "clip.50k.mkv")


def _packets(path: Path) -> list[bytes]:
    with av.open(str(path)) as container:
        return [bytes(packet) for packet in container.demux(video=0)]


def test_effects_from_the_command_line(tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    model.write_text(
        "version: 2\nshutter: {rows: 64, columns: 64}\nlight: {lamp: tone}\n"
        "effects:\n  - exposure: {exposure_s: 0.004}\n  - gamma: {exponent: 1.1}\n"
    )
    run("--out", tmp_path / "c.npz", "--model", model, "--duration-s", 1, "--clock-ppm", 20,
        "--effect", "gamma:exponent=1.3", "--effect", "reverse_readout",
        "--effect", "second_lamp:weight=0.1,phase_rad=-1", "--effect", "second_lamp")  # fmt: skip
    effects = json.loads((tmp_path / "c.truth.json").read_text())["effects"]
    told = [(e["name"], next(iter(e["parameters"].values()), None)) for e in effects]
    assert told == [
        ("exposure", 0.004), ("clock_skew", 20.0), ("gamma", 1.3), ("reverse_readout", None),
        ("second_lamp", 0.1), ("second_lamp", 0.1),
    ]  # fmt: skip
    assert effects[4]["parameters"]["phase_rad"] == -1.0


@pytest.fixture
def reference(tmp_path: Path) -> Path:
    """40 s of a 60 Hz grid, of which seconds 12 and 13 are missing."""
    lines = ["time,frequency"] + [
        f"2024-08-19 15:26:{k:02d},{60 + 0.02 * np.sin(k / 5):.6f}"
        for k in range(40)
        if k not in (12, 13)
    ]
    path = tmp_path / "grid.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_measured_reference_with_a_gap(
    tmp_path: Path, reference: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run("--out", tmp_path / "clip.npz", *SMALL, "--reference", reference, "--start-s", 10.5)
    truth = json.loads((tmp_path / "clip.truth.json").read_text())
    assert truth["nominal_hz"] == 60.0
    assert truth["reference_start_s"] == 10.5
    assert truth["bridged_gaps_s"] == [[1.5, 3.5]]
    assert "no value from 1.5 to 3.5 s" in truth["notes"][0]
    assert "no value from 1.5" in capsys.readouterr().err
    freq_hz = 60 + 0.02 * np.sin(np.arange(40) / 5)
    freq_hz[12:14] = np.nan
    grid = GridPath(freq_hz, start_s=10.5)
    slow = [float(np.mean(grid.frequency_hz(t - 0.5 + np.arange(1000) / 1000)))
            for t in truth["t_s"]]  # fmt: skip
    assert truth["enf_hz"] == pytest.approx(slow, abs=2e-6)


def test_a_reference_shorter_than_the_clip(tmp_path: Path, reference: Path) -> None:
    with pytest.raises(UsageError, match="has 2 s left at 38 s"):
        run("--out", tmp_path / "c.mp4", *SMALL, "--reference", reference, "--start-s", 38)
    assert list(tmp_path.iterdir()) == [reference]


def test_the_command_line_goes_over_the_model_file(tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    model.write_text("version: 2\nname: mine\nshutter: {rows: 64, idle_ratio: 0.1}\n"
                     "codec: {lossless: true}\n")  # fmt: skip
    run("--out", tmp_path / "c.mp4", "--model", model, "--duration-s", 1, "--idle-ratio", 0.2,
        "--bitrate", "150k")  # fmt: skip
    told = json.loads((tmp_path / "c.truth.json").read_text())["model"]
    assert told["name"] == "mine"
    assert (told["shutter"]["rows"], told["shutter"]["idle_ratio"]) == (64, 0.2)
    assert (told["codec"]["bitrate_bps"], told["codec"]["lossless"]) == (150_000, False)


def test_a_misspelled_key_is_named_with_its_line(tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    model.write_text("version: 2\nshutter:\n  rows: 64\n  idle_ration: 0.1\n")
    with pytest.raises(ConfigError, match=r"m\.yaml:4: .*idle_ration.*did you mean 'idle_ratio'"):
        run("--out", tmp_path / "c.mp4", "--model", model)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--idle-ratio", "1.2"], "shutter.idle_ratio is 1.2"),
        (["--frame-rate", "quick"], "not a frame rate"),
        (["--bitrate", "150k", "--lossless"], "excludes codec.bitrate_bps"),
        (["--effect", "gama"], "did you mean 'gamma'"),
        (["--effect", "gamma:name=2"], "effects.gamma.name is not a known key"),
        (["--effect", "gamma:exponent"], "'exponent' is not PARAMETER=VALUE"),
        (["--effect", "gamma:exponent=steep"], "effects.gamma.exponent is 'steep', not of the"),
        (["--effect", "exposure:exposure_s=0.5"], "longer than a frame"),
        (["--effects", "nowhere.py"], "nowhere.py: not a Python file"),
    ],
)
def test_options_that_can_t_be_meant(tmp_path: Path, options: list[str], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        run("--out", tmp_path / "c.mp4", *SMALL, *options)
    assert list(tmp_path.iterdir()) == []


def test_the_catalogue_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run("--list-effects")
    assert ended.value.code == 0
    out = capsys.readouterr().out
    for name, effect in CATALOGUE.items():
        assert f"\n{name}\n" in "\n" + out
        assert all(f"    {f.name} = " in out for f in dataclasses.fields(effect))
    assert "    gain_ratio = 0.002: rms of the gain about 1, 0 to 0.3" in out
    assert max(map(len, out.splitlines())) <= 130


def test_row_means_aren_t_encoded(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="row means aren't encoded"):
        run("--out", tmp_path / "c.npz", *SMALL, "--encodings", "150k")


def test_an_effect_s_mistake_is_named_with_its_line(tmp_path: Path) -> None:
    model = tmp_path / "m.yaml"
    model.write_text("version: 2\neffects:\n  - reverse_readout:\n  - gamma:\n      exponnt: 2\n")
    with pytest.raises(ConfigError, match=r"m\.yaml:5: .*exponnt"):
        run("--out", tmp_path / "c.mp4", "--model", model)


def test_an_unknown_kind_of_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="not a video file's name"):
        run("--out", tmp_path / "c.txt", *SMALL)
    assert list(tmp_path.iterdir()) == []


def test_the_module_is_light_to_import() -> None:
    code = (
        "import sys, rsenf.cli.simulate\n"
        "heavy = {'numpy', 'av', 'cv2', 'scipy', 'rich', 'pydantic'} & set(sys.modules)\n"
        "sys.exit(', '.join(sorted(heavy)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
