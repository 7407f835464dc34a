"""The discover node: verdicts on a running graph, recorded; stopped in the midst of its work."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest
import yaml
from live_run import LiveRun
from run_samples import node_on

from rsenf.bus.inbox import Inbox
from rsenf.errors import EXIT_DONE, InputError
from rsenf.record import open_recording
from rsenf.run.pump import BEHIND, NodeContext
from tests.in_time import in_time
from tests.loopback import Loopback

MODEL = """\
version: 2
light: {lamp: tone}
shutter: {rows: 48, columns: 64, idle_ratio: 0.38}
effects: [{interharmonic: {flicker_hz: 8.8, depth_ratio: 0.004}}]
"""
GRAPH = """\
version: 1
site: lab
nodes:
  decode:
    {{kind: decode, camera: cam, input: {{model: "{model}", duration_s: {seconds}}}, frames: fused}}
  discover: {{kind: discover, cameras: [cam], discover: {{nominal_hz: 50, window_s: {window}}}}}
  record: {{kind: record, out: "{out}"}}
"""


def write(folder: Path, **values: object) -> Path:
    model, graph = folder / "model.yaml", folder / "graph.yaml"
    model.write_text(MODEL, encoding="utf-8")
    text = GRAPH.format(model=model, out=folder / "out.mcap", **values)
    graph.write_text(text, encoding="utf-8")
    return graph


@pytest.mark.processes
def test_a_verdict_comes_out_and_is_recorded(live_run: type[LiveRun], tmp_path: Path) -> None:
    run = live_run(write(tmp_path, seconds=28, window=25), "--json")
    assert run.wait() == EXIT_DONE, run.lines
    assert any("cam explained (interharmonic), gap" in line for line in run.lines)
    printed = json.load(run.process.stdout)["discover"]["lab/cam"]  # type: ignore[arg-type]
    assert [e["name"] for e in printed["effects"]] == ["interharmonic"]
    assert abs(printed["gap"]["after"]) < printed["gap"]["limit"]
    messages = open_recording(tmp_path / "out.mcap").messages(["rsenf/lab/cam/discover"])
    told = [m for _, m, _ in messages]
    assert told[-1].header.is_end
    first, *_ = told
    assert (first.verdict, [e.name for e in first.effects]) == ("explained", ["interharmonic"])
    assert (first.header.source, first.header.frame_first) == ("lab/cam", 0)
    assert "- interharmonic:" in first.model_yaml


@pytest.mark.processes
def test_it_stops_in_the_midst_of_its_work(live_run: type[LiveRun], tmp_path: Path) -> None:
    run = live_run(write(tmp_path, seconds=60, window=200)).until("done", "decode")
    assert in_time(run.interrupt(), 5.0)
    assert run.process.returncode == EXIT_DONE, run.lines
    assert run.states["discover"][-1] == "done"
    assert run.states["record"][-1] == "done"
    assert list(open_recording(tmp_path / "out.mcap").messages(["rsenf/lab/cam/rows"]))


def test_work_is_given_up_when_the_node_is_told_to_stop() -> None:
    node, never = node_on(Loopback(), "track"), threading.Event()
    context = NodeContext(node, "cam")
    assert context.run(lambda: "done") == "done"

    def fails() -> None:
        raise InputError("no flicker")

    with pytest.raises(InputError, match="no flicker"):
        context.run(fails)
    threading.Timer(0.1, node.stop.set).start()
    assert context.run(never.wait) is None
    never.set()


@pytest.mark.parametrize(
    ("source", "waits"),
    [
        ("input: a.mp4", True),
        ("input: {model: a.yaml}", True),
        ("input: a.mp4, pace: true", False),
        ("input: 'rtsp://host/a'", False),
        ("input: 'v4l2:/dev/video0'", False),
    ],
)
def test_only_a_camera_that_can_be_made_to_wait_is_never_skipped(
    source: str, waits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    decode = f"d: {{kind: decode, camera: cam, {source}}}"
    text = f"{{version: 1, site: lab, nodes: {{{decode}, w: {{kind: discover, cameras: [cam]}}}}}}"
    node = node_on(Loopback(), "w", yaml.safe_load(text))
    context, of_others = NodeContext(node, "cam"), NodeContext(node, "of another graph")
    monkeypatch.setattr(Inbox, "depth", BEHIND + 1)
    assert context.is_behind() is not waits
    assert of_others.is_behind()
    monkeypatch.setattr(Inbox, "depth", BEHIND)
    assert not context.is_behind()
