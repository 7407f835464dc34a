"""A kind of node of another package, by its entry point: validated, run, recorded, run again."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from live_run import LiveRun

from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_USAGE
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


def test_without_the_package_its_kind_is_unknown(
    installed: dict[str, str], graph: Path, live_run: type[LiveRun], tmp_path: Path
) -> None:
    assert live_run(graph, env=installed).wait() == EXIT_DONE
    checked = rsenf("validate", graph, env=dict(os.environ))
    assert checked.returncode == EXIT_USAGE
    assert "nodes.band.kind: 'band' is not one of" in checked.stderr
    again = rsenf("regress", tmp_path / "out.mcap", env=dict(os.environ))
    assert again.returncode == EXIT_FAILED
    assert "out.mcap: no node kind 'band' here, of nodes.band" in again.stderr
    assert "install the package that adds it: band 1.0" in again.stderr
    facts = tmp_path / "band-1.0.dist-info/METADATA"
    facts.write_text(facts.read_text().replace("1.0", "1.1"))
    newer = rsenf("regress", tmp_path / "out.mcap", env=installed)
    assert "package band 1.0 → 1.1" in newer.stdout


def test_one_that_sends_what_it_does_not_declare_fails_in_one_line(
    installed: dict[str, str], graph: Path, live_run: type[LiveRun], tmp_path: Path
) -> None:
    """It would go unseen by validate, supervision and regress."""
    (tmp_path / "band_node.py").write_text(KIND.replace("SENDS", "discover"))
    run = live_run(graph, env=installed)
    assert run.wait() == 1
    assert "BandNode sends Alarm undeclared (name its topic in StageSpec.sends)" in run.error


@pytest.mark.parametrize(
    ("module", "why"),
    [
        ("import nowhere\n", "ModuleNotFoundError"),
        (KIND.replace('Literal["band"]', 'Literal["bend"]'), 'kind: Literal["band"] in it'),
        ("BandNode = 3\n", "band is no rsenf.config.node_kind.NodeKind"),
    ],
)
def test_one_that_is_none_is_told_of_where_it_is_used(
    installed: dict[str, str], graph: Path, tmp_path: Path, module: str, why: str
) -> None:
    (tmp_path / "band_node.py").write_text(module)
    checked = rsenf("validate", graph, env=installed)
    assert checked.returncode == EXIT_USAGE
    assert "nodes.band.kind: node kind 'band' of the package band can't be loaded" in checked.stderr
    assert why in checked.stderr
    text = graph.read_text(encoding="utf-8").splitlines()
    graph.write_text("\n".join(line for line in text if "band" not in line), encoding="utf-8")
    others = rsenf("validate", graph, env=installed)
    assert (others.returncode, others.stderr) == (EXIT_DONE, "")


def test_one_of_a_topic_that_is_none_is_refused(
    installed: dict[str, str], graph: Path, tmp_path: Path
) -> None:
    (tmp_path / "band_node.py").write_text(KIND.replace("SENDS", "quality"))
    checked = rsenf("validate", graph, env=installed)
    assert checked.returncode == EXIT_USAGE
    assert "nodes.band.cameras: sends 'quality', which is no topic" in checked.stderr
