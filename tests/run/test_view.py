"""How a run looks: words of a node are never taken for markup, nor shown when all is quiet."""

from __future__ import annotations

import io

import pytest
from rich.console import Console
from run_samples import GRAPH, nobody

from rsenf.config import Graph
from rsenf.messages import Header, Health
from rsenf.run.graph_run import GraphRun
from rsenf.run.node_state import NodeState
from rsenf.run.view import LineView, TableView


@pytest.fixture
def run() -> GraphRun:
    graph = Graph.model_validate(GRAPH)
    nodes = {name: NodeState(name, config.kind) for name, config in graph.nodes.items()}
    return GraphRun(graph, "1a2b", "tcp/127.0.0.1:7447", nodes, lambda node: None, nobody)


def test_the_table(run: GraphRun) -> None:
    out = io.StringIO()
    view = TableView(run.graph)
    console = Console(file=out, width=140)
    console.print(view)  # nothing yet
    view.started(run)
    decode = run.nodes["decode"]
    decode.state, decode.detail = "failed", "[/cam] said [bold]no[/bold]"
    decode.health = Health(
        header=Header(), messages_in=17, missed=4, rate_hz=29.97, lost_peers=("rows",)
    )
    console.print(view)
    text = out.getvalue()
    assert "lost: rows [/cam] said [bold]no[/bold]" in text
    assert "30.0" in text
    assert "tcp/127.0.0.1:7447" in text
    assert all(name in text for name in run.nodes)


@pytest.mark.parametrize(("quiet", "lines"), [(False, 4), (True, 2)])
def test_the_lines(
    run: GraphRun, quiet: bool, lines: int, capsys: pytest.CaptureFixture[str]
) -> None:
    view = LineView(quiet=quiet)
    view.started(run)
    for state in ("running", "failed", "lost"):
        run.nodes["rows"].state, run.nodes["rows"].detail = state, "a reason"
        view.update(run.nodes["rows"])
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == lines
    assert "rows: lost a reason" in printed.err
