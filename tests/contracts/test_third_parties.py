"""A package of somebody else's, installed beside rsenf: what it adds is there, by name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

THEIRS = '''
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rsenf.match import Finding, Grid, MatchSettings, Track
from rsenf.match.correlate import match_ncc
from rsenf.model.effects import LightEffect, Run, Weakest
from rsenf.model.line_light import LineLight
from rsenf.model.parameters import Fitting, parameter
from rsenf.track.stft import StftTracker


class Theirs(StftTracker):
    name = "theirs"
    help = "reads the strongest line in windows of 10 s"

    def __init__(self, settings=None):
        super().__init__(replace(settings, window_s=10.0))


@dataclass(frozen=True, kw_only=True)
class Ramp(LightEffect):
    """The light becomes stronger and stronger, as a lamp does that warms up."""

    name = "ramp"
    source = "discharge lamps"
    confused_with = ("auto_exposure",)
    told_apart_by = "it never comes back"
    weakest = Weakest(0.01, "rise_per_min")

    rise_per_min: float = parameter(
        0.1, "relative change in a minute", low=-0.5, high=0.5, fitting=Fitting(0.0, 0.01)
    )

    def apply(self, light: LineLight, run: Run) -> None:
        light.scale(1 + self.rise_per_min / 60 * light.start_s)


def idle(seen):
    from rsenf.idle.coherent import conclude

    return conclude(seen)


def matcher(track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns=0):
    return replace(match_ncc(track, grids[0], settings), grid=grids[0])
'''
FACTS = """[rsenf.methods]
theirs = their_package:Theirs
[rsenf.idle_methods]
theirs = their_package:idle
[rsenf.matchers]
theirs = their_package:matcher
[rsenf.effects]
ramp = their_package:Ramp
misnamed = their_package:Ramp
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the package, as pip would."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "their_package.py").write_text(THEIRS)
    facts = folder / "their_package-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(FACTS)
    return folder


def rsenf(site: Path, *words: object) -> subprocess.CompletedProcess[str]:
    paths = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, "-m", "rsenf.cli", *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    )


@pytest.fixture(scope="module")
def filmed(site: Path) -> Path:
    """Film rows under their effect, in half a minute."""
    out = site / "rows.npz"
    clip = ("--duration-s", 31, "--size", "96x64", "--idle-ratio", 0.3)
    done = rsenf(site, "simulate", "--out", out, *clip, "--effect", "ramp:rise_per_min=0.2")
    assert done.returncode == 0, done.stderr
    return out


def test_their_effect_is_simulated(site: Path, filmed: Path) -> None:
    with np.load(filmed) as data:
        mean = data["rows"].mean(axis=(1, 2)) if data["rows"].ndim == 3 else data["rows"].mean(1)
        t_s = data["frame_time_s"]
    assert 60 * np.polyfit(t_s, mean / mean[:30].mean(), 1)[0] == pytest.approx(0.2, rel=0.05)
    truth = json.loads(filmed.with_suffix(".truth.json").read_text())
    assert truth["effects"][-1]["name"] == "ramp"


def test_their_effect_is_told_of(site: Path) -> None:
    told = rsenf(site, "simulate", "--list-effects")
    assert told.returncode == 0
    assert "\nramp" in told.stdout
    # What can't be loaded hinders nobody but who asks for it, and says whose it is.
    asked = rsenf(site, "simulate", "--out", site / "x.npz", "--effect", "misnamed")
    assert asked.returncode == 2
    assert "'misnamed' of the package their-package can't be loaded" in asked.stderr


def test_their_method_tracks(site: Path, filmed: Path) -> None:
    done = rsenf(site, "track", filmed, "--method", "theirs", "--json")
    assert done.returncode == 0, done.stderr
    values = [json.loads(line) for line in done.stdout.splitlines()]
    assert values[0]["t_s"] == pytest.approx(5.0, abs=0.01)
    truth = json.loads(filmed.with_suffix(".truth.json").read_text())
    true_hz = np.interp([v["t_s"] for v in values], truth["t_s"], truth["enf_hz"])
    assert [v["enf_hz"] for v in values] == pytest.approx(true_hz, abs=5e-3)


def test_their_idle_method_estimates(site: Path, filmed: Path) -> None:
    done = rsenf(site, "idle", filmed, "--method", "theirs", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["idle_ratio"] == pytest.approx(0.3, abs=0.01)


def test_their_matcher_compares(site: Path, filmed: Path) -> None:
    truth = json.loads(filmed.with_suffix(".truth.json").read_text())
    reference = site / "reference.csv"
    reference.write_text("frequency\n" + "\n".join(map(str, 3 * truth["enf_hz"])) + "\n")
    words = ("verify", filmed, "--reference", reference, "--step-s", 1)
    done = rsenf(site, *words, "--method", "theirs", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["method"] == "theirs"


def test_a_misspelt_name_gets_theirs(site: Path, filmed: Path) -> None:
    done = rsenf(site, "track", filmed, "--method", "their")
    assert done.returncode == 2
    assert "did you mean 'theirs'" in done.stderr
