"""Clips, a grid, and graphs on them, for tests that start processes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from live_run import LiveRun

from rsenf.bus.ring import ring_directory


@dataclass(frozen=True)
class Film:
    """A simulated clip and the grid that it was filmed on."""

    video: Path
    reference: Path
    lag_s: float
    idle_ratio: float = 0.38


def made_film(folder: Path, duration_s: float, size: str = "240x180") -> Film:
    rng = np.random.default_rng(5)
    freq_hz = 50 + np.cumsum(rng.normal(0, 0.002, 1200)) * np.exp(-np.arange(1200) / 2000)
    lines = [f"{k},{f:.6f}" for k, f in enumerate(freq_hz)]
    film = Film(folder / "film.mp4", folder / "grid.csv", 456.25)
    film.reference.write_text("\n".join(["time_s,frequency", *lines, ""]), encoding="utf-8")
    words = ["simulate", "--out", film.video, "--reference", film.reference, "--start-s",
             film.lag_s, "--duration-s", duration_s, "--size", size, "--seed", 5]  # fmt: skip
    subprocess.run([sys.executable, "-m", "rsenf.cli", *map(str, words)], check=True)
    return film


@pytest.fixture(scope="session")
def film(tmp_path_factory: pytest.TempPathFactory) -> Film:
    """75 seconds: enough to be found in the grid."""
    return made_film(tmp_path_factory.mktemp("film"), 75)


@pytest.fixture(scope="session")
def short_film(tmp_path_factory: pytest.TempPathFactory) -> Film:
    """Three seconds: to be played at their own pace."""
    return made_film(tmp_path_factory.mktemp("short"), 3)


GRAPH = """\
version: 1
site: lab
nodes:
  decode: {{kind: decode, camera: cam, input: "{video}", frames: {frames}, pace: {pace}}}
  rows:   {{kind: rows, cameras: [cam]}}
  track:  {{kind: track, cameras: [cam], track: {{method: {method}, nominal_hz: 50}}}}
  idle:   {{kind: idle, cameras: [cam], idle: {{nominal_hz: 50}}}}
  grid:   {{kind: reference, grid: ce, input: "{reference}"}}
  match:  {{kind: match, cameras: [cam], grid: ce, method: {matcher}}}
  record: {{kind: record, out: "{out}"}}
"""


@dataclass(frozen=True)
class Graphs:
    """Writes graph files."""

    folder: Path

    @property
    def out(self) -> Path:
        """Where they record."""
        return self.folder / "out.mcap"

    def write(
        self,
        film: Film,
        frames: str = "ring",
        *,
        pace: bool = False,
        together: bool = False,
        **more: object,
    ) -> Path:
        """Write a graph of all seven kinds of nodes; of six, where one tracks and estimates."""
        values = {
            "video": film.video,
            "reference": film.reference,
            "out": self.out,
            "method": "stft",
            "matcher": "phase",
            **more,
        }
        text = GRAPH.format(frames=frames, pace=str(pace).lower(), **values)
        if frames == "fused":
            text = text.replace("  rows:   {kind: rows, cameras: [cam]}\n", "")
        if together:
            alone = "}\n  idle:   {kind: idle, cameras: [cam], idle: {nominal_hz: 50}}\n"
            text = text.replace(alone, ", idle: {nominal_hz: 50}}\n")
        path = self.folder / "graph.yaml"
        path.write_text(text, encoding="utf-8")
        return path


@pytest.fixture
def graphs(tmp_path: Path) -> Graphs:
    """A folder for a graph and what it records."""
    return Graphs(tmp_path)


@pytest.fixture
def live_run() -> Iterator[type[LiveRun]]:
    """Starts ``rsenf run``; afterwards nothing of it may be left."""
    yield LiveRun
    started = list(LiveRun.started)
    LiveRun.started.clear()
    for run in started:
        run.kill()
    assert [run.graph for run in started if run.left] == []
    for run_id in [run.run_id for run in started if run.run_id]:
        assert list(ring_directory().glob(f"rsenf-{run_id}*")) == []
