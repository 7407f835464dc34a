"""The functions give what the command line prints, to the bit: from a path and from arrays."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rsenf
from rsenf.cli import main
from rsenf.reference import read_reference
from tests.hidden_clip import HiddenClip

Said = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def arrays(hidden: HiddenClip) -> dict[str, Any]:
    """The hidden clip as arrays."""
    with np.load(hidden.clip) as held:
        return {"recording": held["rows"], "frame_time_s": held["frame_time_s"]}


@pytest.fixture(scope="module")
def grid_hz(hidden: HiddenClip) -> Any:
    return read_reference(hidden.reference).freq_hz


def printed(said: Said, *words: object) -> str:
    assert main([str(word) for word in words]) == 0
    return said.readouterr().out


def test_track(hidden: HiddenClip, arrays: dict[str, Any], capsys: Said) -> None:
    for more in ({}, {"method": "stft"}, {"method": "superpixel"}):
        words = [word for name, value in more.items() for word in (f"--{name}", value)]
        out = printed(capsys, "track", hidden.clip, "--json", *words)
        lines = [json.loads(line) for line in out.splitlines()]
        found = rsenf.track(hidden.clip, **more)
        assert found.to_dict()["estimates"] == lines
        assert rsenf.track(**arrays, **more).to_dict()["estimates"] == lines
        assert [round(t_s, 6) for t_s in found.t_s.tolist()] == [e["t_s"] for e in lines]
        usable = [e for e in lines if e["usable"]]
        assert found.enf_hz[found.usable].tolist() == [e["enf_hz"] for e in usable]
        assert found.enf_std_hz[found.usable].tolist() == [e["enf_std_hz"] for e in usable]
    assert f"{rsenf.track(hidden.clip)}\n" == printed(capsys, "track", hidden.clip)


def test_idle(hidden: HiddenClip, arrays: dict[str, Any], capsys: Said) -> None:
    told = json.loads(printed(capsys, "idle", hidden.clip, "--json"))
    found = rsenf.idle(hidden.clip)
    assert found.to_dict() == rsenf.idle(**arrays).to_dict() == told
    assert found.idle_ratio == told["idle_ratio"]
    assert f"{found}\n" == printed(capsys, "idle", hidden.clip)
    both = rsenf.compare_idle(found, found)
    words = ("idle", hidden.clip, hidden.clip)
    assert both.to_dict() == json.loads(printed(capsys, *words, "--json"))
    assert printed(capsys, *words).endswith(f"\n{both}\n")


def test_camera(hidden: HiddenClip, arrays: dict[str, Any], tmp_path: Path, capsys: Said) -> None:
    a, b = tmp_path / "a", tmp_path / "b"
    words = ("camera", "add", "phone", hidden.clip, "--crop", "stabilised", "--clock-ppm", 12)
    told = json.loads(printed(capsys, *words, "--store", a, "--json"))
    found = rsenf.idle(hidden.clip)
    known = rsenf.add_camera("phone", found, store=b, crop="stabilised", clock_ppm=12.0)
    assert known.to_dict() | {"store": str(a)} == told
    assert (a / "cameras.json").read_bytes() == (b / "cameras.json").read_bytes()
    assert rsenf.list_cameras(a).to_dict() == told
    assert printed(capsys, "camera", "list", "--store", a) == f"{known}\n"
    again = rsenf.identify_camera(rsenf.idle(**arrays), store=a)
    assert again.verdict == "compatible"  # of arrays it isn't known that they are that file
    words = ("camera", "identify", hidden.clip, "--store", a)
    own = rsenf.identify_camera(found, store=a)
    assert own.to_dict() == json.loads(printed(capsys, *words, "--json"))
    assert own.verdict == "undecidable"
    assert printed(capsys, *words) == f"{own}\n"


def test_verify(hidden: HiddenClip, arrays: dict[str, Any], grid_hz: Any, capsys: Said) -> None:
    words = ("verify", hidden.clip, "--reference", hidden.reference, "--start", hidden.start_utc)
    told = json.loads(printed(capsys, *words, "--json"))
    assert (told["decision"], told["claim"]) == ("match", "supported")
    found = rsenf.verify(hidden.clip, hidden.reference, start=hidden.start_utc)
    assert found.to_dict() == told
    assert f"{found}\n" == printed(capsys, *words)
    begins = "2024-03-01T10:00:00Z"
    again = rsenf.verify(
        **arrays, reference=grid_hz, step_s=1.0, reference_start=begins, start=hidden.start_utc
    )
    # Of its name only, and what a name is in, an array tells otherwise.
    named = {"grid": "array", "candidates": [c | {"grid": "array"} for c in told["candidates"]]}
    assert again.to_dict() == told | named
    assert again.reference.freq_hz.tolist() == found.reference.freq_hz.tolist()


def test_verify_by_a_store(hidden: HiddenClip, tmp_path: Path, capsys: Said) -> None:
    store = tmp_path / "store"
    words = ("reference", "import", hidden.reference, "--grid", "here", "--store", store)
    assert main([str(word) for word in words]) == 0
    capsys.readouterr()
    words = ("verify", hidden.clip, "--reference", "store:here", "--store", store, "--json")
    told = json.loads(printed(capsys, *words))
    assert rsenf.verify(hidden.clip, "store:here", store=store).to_dict() == told


def test_verify_against(hidden: HiddenClip, capsys: Said) -> None:
    words = ("verify", hidden.clip, "--against", hidden.clip)
    tracked = rsenf.track(hidden.clip)
    found = rsenf.verify_against(tracked, tracked)
    assert found.to_dict() == json.loads(printed(capsys, *words, "--json"))
    assert printed(capsys, *words).startswith(f"{found}\n")


def test_live(hidden: HiddenClip, arrays: dict[str, Any], grid_hz: Any, capsys: Said) -> None:
    words = ("live", hidden.clip, "--reference", hidden.reference, "--start", hidden.start_utc)
    told = json.loads(printed(capsys, *words, "--json"))
    found = rsenf.live(hidden.clip, hidden.reference, start=hidden.start_utc)
    assert found.to_dict() == told
    assert f"{found}\n" == printed(capsys, *words)
    begins = "2024-03-01T10:00:00Z"
    again = rsenf.live(
        **arrays, reference=grid_hz, step_s=1.0, reference_start=begins, start=hidden.start_utc
    )
    # An array has no name to tell.
    assert json.loads(json.dumps(again.to_dict()).replace("follows array", "follows grid")) == told


def test_discover(tmp_path: Path, capsys: Said) -> None:
    clip = tmp_path / "clip.npz"
    made = rsenf.simulate(clip, duration_s=30, seed=2, size=(64, 48), frame_rate=25)
    told = json.loads(printed(capsys, "discover", clip, "--out", tmp_path / "found", "--json"))
    found = rsenf.discover(made.rows, frame_time_s=made.frame_time_s)
    assert found.to_dict() | {"model_out": told["model_out"]} == told
    assert found.verdict == told["verdict"]


@pytest.mark.parametrize("name", ["clip.npz", "clip.mcap", "clip.mp4"])
def test_simulate(name: str, tmp_path: Path, capsys: Said) -> None:
    more = ("--duration-s", 3, "--seed", 4, "--size", "64x48", "--idle-ratio", "0.25")
    told = json.loads(printed(capsys, "simulate", "--out", tmp_path / name, *more, "--json"))
    bytes_there = (tmp_path / name).read_bytes()
    made = rsenf.simulate(tmp_path / name, duration_s=3, seed=4, size=(64, 48), idle_ratio=0.25)
    assert made.to_dict() == told
    if name != "clip.mcap":  # which has the time of its making in it
        assert (tmp_path / name).read_bytes() == bytes_there
    if made.data:
        held = rsenf.read_recording(tmp_path / name)
        assert np.array_equal(held.rows, made.rows)
        assert np.allclose(held.frame_time_s, made.frame_time_s, rtol=0, atol=1e-9)


def test_a_recording_read_once_serves_every_analysis(clip: Path) -> None:
    held = rsenf.read_recording(clip)
    assert held.rows.shape[0] == held.frame_time_s.size
    assert rsenf.track(held).to_dict() == rsenf.track(clip).to_dict()
    assert rsenf.idle(held).to_dict() == rsenf.idle(clip).to_dict()
