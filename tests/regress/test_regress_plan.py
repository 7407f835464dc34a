"""Which stages a recorded graph has."""

from __future__ import annotations

import pytest

from rsenf.config import Graph
from rsenf.messages import Header, IdleEstimate, Mark, RowBlock
from rsenf.record import open_recording
from rsenf.regress import rerun
from rsenf.regress.plan import History, recorded_graph, steps_of
from tests.conftest import ROOT


def test_a_node_of_two_stages_is_two_steps() -> None:
    graph = Graph.model_validate({
        "version": 1,
        "site": "lab",
        "nodes": {
            "decode": {"kind": "decode", "camera": "cam", "input": "a.mp4", "frames": "fused"},
            "both": {"kind": "track", "cameras": ["cam"], "idle": {"every_s": 7}},
        },
    })  # fmt: skip
    found = steps_of(graph)
    steps = [(step.stage, step.node, step.topic, step.reads) for step in found]
    rows = ("rsenf/lab/cam/rows",)
    assert steps == [
        ("rows", "decode", "rsenf/lab/cam/rows", ("rsenf/lab/cam/video",)),
        ("track", "both", "rsenf/lab/cam/track", rows),
        ("idle", "both", "rsenf/lab/cam/idle", rows),
    ]
    (told,) = (
        found[2]
        .make_runner(found[2].context(History()))
        .feed(RowBlock(header=Header(mark=Mark.END)))
    )
    assert isinstance(told, IdleEstimate)


def test_what_no_node_is_said_to_send_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages that nobody can make again aren't passed over in silence."""
    recording = open_recording(next((ROOT / "recordings").glob("*.mcap")))
    whole = recorded_graph(recording)
    own = {"kind": "external", "command": ["own"], "sends": ["cam/track"]}
    nodes = {name: node for name, node in whole.nodes.items() if node.kind not in ("idle", "track")}
    config = whole.model_dump() | {"nodes": {**nodes, "own": own}}
    monkeypatch.setattr(rerun, "recorded_graph", lambda _: Graph.model_validate(config))
    _, left_out = rerun.runnable(recording)
    assert left_out == {
        "rsenf/golden/cam/idle": "no node of its graph is said to send it",
        "rsenf/golden/cam/track": "the program of node 'own' made it",
    }
