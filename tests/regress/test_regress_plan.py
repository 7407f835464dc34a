"""Which stages a recorded graph has."""

from __future__ import annotations

from rsenf.config import Graph
from rsenf.messages import Header, IdleEstimate, Mark, RowBlock
from rsenf.regress.history import History
from rsenf.regress.plan import steps_of


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
    (told,) = found[2].make_runner(History()).feed(RowBlock(header=Header(mark=Mark.END)))
    assert isinstance(told, IdleEstimate)
