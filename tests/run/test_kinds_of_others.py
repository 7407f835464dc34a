"""A kind of node of another package, by its entry point: validated, run, recorded, run again."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from live_run import LiveRun

from rsenf.errors import EXIT_DONE, EXIT_USAGE
from tests.conftest import ROOT

pytestmark = pytest.mark.processes

KIND = '''\
"""Raises an alarm when the grid leaves its band."""

from typing import Literal

from pydantic import Field

from rsenf.messages import Alarm
from rsenf.run.stage_node import StageNode
from rsenf.stage import ALONE, StageContext, StageSpec


class Band:
    def __init__(self, band_hz):
        self.band_hz, self.sent = band_hz, 0

    def update(self, estimate):
        away_hz = abs(estimate.enf_hz - estimate.nominal_hz)
        if not estimate.usable or away_hz <= self.band_hz:
            return []
        header = estimate.header.numbered(self.sent)
        self.sent += 1
        return [Alarm(header=header, kind="enf_outside", value=away_hz, limit=self.band_hz)]

    def flush(self):
        return []


class BandNode(StageNode):
    """Raises an alarm when the grid leaves its band."""

    kind: Literal["band"]
    band_hz: float = Field(0.2, gt=0, description="half of its width")

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        return [StageSpec(("SENDS",), ("track",), lambda: Band(self.band_hz))]
'''
GRAPH = """\
version: 1
site: lab
nodes:
  decode: {{kind: decode, camera: cam, input: "{film}", frames: fused}}
  track: {{kind: track, cameras: [cam], track: {{nominal_hz: 50}}}}
  band: {{kind: band, cameras: [cam], band_hz: 1.0e-6}}
  record: {{kind: record, out: "{out}"}}
"""


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """Surroundings in which the package is there."""
    facts = tmp_path / "band-1.0.dist-info"
    facts.mkdir()
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: band\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text("[rsenf.nodes]\nband = band_node:BandNode\n")
    (tmp_path / "band_node.py").write_text(KIND.replace("SENDS", "alarm"))
    return {**os.environ, "PYTHONPATH": str(tmp_path)}


@pytest.fixture
def graph(tmp_path: Path) -> Path:
    path, model = tmp_path / "graph.yaml", ROOT / "configs/model/demo_480p.yaml"
    film = tmp_path / "film.mp4"
    words = ["simulate", "--out", film, "--duration-s", "12", "--size", "64x48", "--model", model]
    subprocess.run([sys.executable, "-m", "rsenf.cli", *map(str, words)], check=True)
    path.write_text(GRAPH.format(film=film, out=tmp_path / "out.mcap"), encoding="utf-8")
    return path


def rsenf(*words: object, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rsenf.cli", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, env=env)


def test_it_is_validated_run_recorded_and_run_again(
    installed: dict[str, str], graph: Path, live_run: type[LiveRun], tmp_path: Path
) -> None:
    checked = rsenf("validate", graph, env=installed)
    assert checked.returncode == EXIT_DONE, checked.stderr
    assert "sends alarm of cam" in checked.stdout
    run = live_run(graph, "--json", env=installed)
    assert run.wait() == EXIT_DONE, run.lines
    alarms = json.load(run.process.stdout)["alarms"]["lab/cam"]  # type: ignore[arg-type]
    assert alarms
    again = rsenf("regress", tmp_path / "out.mcap", "--json", env=installed)
    topics = {t["topic"]: t for t in json.loads(again.stdout)["topics"]}
    alarm = topics["rsenf/lab/cam/alarm"]
    assert (alarm["differing"], alarm["unjudged"]) == (0, "")
    assert alarm["messages"] == len(alarms) + 1  # its END mark


def test_without_the_package_its_kind_is_unknown(graph: Path) -> None:
    checked = rsenf("validate", graph, env=dict(os.environ))
    assert checked.returncode == EXIT_USAGE
    assert "nodes.band.kind: 'band' is not one of" in checked.stderr


def test_one_that_sends_what_it_does_not_declare_fails_in_one_line(
    installed: dict[str, str], graph: Path, live_run: type[LiveRun], tmp_path: Path
) -> None:
    """It would go unseen by validate, supervision and regress."""
    (tmp_path / "band_node.py").write_text(KIND.replace("SENDS", "discover"))
    run = live_run(graph, env=installed)
    assert run.wait() == 1
    assert "BandNode sends Alarm undeclared (name its topic in StageSpec.sends)" in run.error


def test_one_that_cannot_be_loaded_is_told_of_and_hinders_nobody(
    installed: dict[str, str], graph: Path, tmp_path: Path
) -> None:
    (tmp_path / "band_node.py").write_text("import nowhere\n")
    checked = rsenf("validate", graph, env=installed)
    assert checked.returncode == EXIT_USAGE
    assert "node kind 'band' of the package band can't be loaded" in checked.stderr
    text = graph.read_text(encoding="utf-8").splitlines()
    graph.write_text("\n".join(line for line in text if "band" not in line), encoding="utf-8")
    assert rsenf("validate", graph, env=installed).returncode == EXIT_DONE
