"""How a run looks: words of a node are never taken for markup, nor shown when all is quiet."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from datetime import datetime

import pytest
from rich.console import Console
from run_samples import GRAPH, nobody

from rsenf.config import Graph
from rsenf.messages import Alarm, Header, Health, Liveness
from rsenf.run import log
from rsenf.run.graph_run import GraphRun
from rsenf.run.restart_policy import NodeState
from rsenf.run.view import SUMMARY_S, EventView, TableView, alarm_line, view_of
from rsenf.timebase import NS_PER_S
from tests.loopback import Loopback


@pytest.fixture
def run() -> GraphRun:
    idle = {"idle": {"kind": "idle", "cameras": ["cam"]}}
    graph = Graph.model_validate(GRAPH | {"nodes": {**GRAPH["nodes"], **idle}})
    nodes = {name: NodeState(name, config.kind) for name, config in graph.nodes.items()}
    bus = Loopback().bus("supervisor")
    return GraphRun(graph, "1a2b", "tcp/127.0.0.1:7447", nodes, lambda node: None, nobody, bus)


def test_a_log_of_json_lines(
    run: GraphRun, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(log.ASKED, "json")
    with view_of(run.graph, quiet=False) as view:
        view.started(run)
        for state, detail in (("running", ""), ("failed", "rtsp://user:hunter2@host/x\nis gone")):
            run.nodes["rows"].state, run.nodes["rows"].detail = state, detail
            view.update(run.nodes["rows"])
        log.complain("words", "password: hunter2", node="rows")
    said = capsys.readouterr().err
    events = [json.loads(text) for text in said.splitlines()]
    assert [e["level"] for e in events] == ["info", "info", "error", "error"]
    assert [e["node"] for e in events] == ["", "rows", "rows", "rows"]
    assert [e["camera"] for e in events] == ["", "cam", "cam", ""]
    assert events[2]["message"] == "failed rtsp://***@host/x\nis gone"
    assert "hunter2" not in said
    assert datetime.fromisoformat(events[0]["time"]).tzinfo


def test_a_node_that_a_reload_has_added(run: GraphRun, capsys: pytest.CaptureFixture[str]) -> None:
    with view_of(run.graph, quiet=False) as view:
        view.started(run)
        second = {"second": GRAPH["nodes"]["decode"] | {"camera": "second"}}  # type: ignore[index]
        run.graph = Graph.model_validate(GRAPH | {"nodes": {**GRAPH["nodes"], **second}})
        node = NodeState("second", "decode", state="running")
        for node.detail in ("", "lost the camera"):
            view.update(node)
    assert capsys.readouterr().err.splitlines()[-1].endswith("running lost the camera")


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
    view = EventView(run.graph, quiet=quiet)
    view.started(run)
    for state in ("running", "failed", "lost"):
        run.nodes["rows"].state, run.nodes["rows"].detail = state, "a reason"
        view.update(run.nodes["rows"])
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == lines
    assert "rows: lost a reason" in printed.err


def test_the_log_has_events_only(
    run: GraphRun, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [0.0]
    monkeypatch.setattr("rsenf.run.view.time.monotonic", lambda: now_s[0])
    view = EventView(run.graph, quiet=False)
    view.started(run)
    for name, details in (("idle", ("", "cam idle 20.0 %")), ("decode", ("connected", "away"))):
        node = run.nodes[name]
        for detail in details:
            node.state, node.detail = "running", detail
            view.update(node)
    for run.nodes["idle"].behind in ("behind by 5 s", "behind by 5 s", ""):
        view.update(run.nodes["idle"])
    run.alarm_counts["lab/cam", "stale"] = 1
    alarm = {"kind": "stale", "severity": "alarm", "text": "late", "start_pts_ns": 39_000_000_000}
    for verdict, evidence in (("live", "lag 0.1 s"), ("live", "lag 0.2 s"), ("stale", "late")):
        if verdict == "stale":
            run.on_result("lab/cam", Alarm(header=Header(), **alarm))
        run.on_result("lab/cam", Liveness(header=Header(), verdict=verdict, evidence=evidence))
    now_s[0] = SUMMARY_S
    ended = {"active": False, "end_pts_ns": 45_000_000_000}
    run.on_result("lab/cam", Alarm(header=Header(), **alarm | ended))
    said = [line.partition("s  ")[2] for line in capsys.readouterr().err.splitlines()]
    assert said[1:] == [
        "idle: running",
        "decode: running connected",
        "decode: running away",
        "idle: behind by 5 s",
        "idle: caught up",
        "lab/cam: live: lag 0.1 s",
        "lab/cam: alarm stale at 39.0 s of the stream: late",
        "lab/cam: stale ended at 45.0 s of the stream: late",
        "feeds: 1 stale; alarms: 1; missed: 0; " + said[-1].rpartition("; ")[2],
    ]
    assert "rows starting" in said[-1]
    assert "decode" not in said[-1]


def test_alarms_of_cameras_are_told_by_the_clock_of_the_host(run: GraphRun) -> None:
    """Which the log of alarms has, too. A file arrives at any time."""
    header = Header(
        source="lab/cam", pts_ns=40 * NS_PER_S, arrival_time_ns=1_768_435_200 * NS_PER_S
    )
    alarm = Alarm(header=header, kind="lost", text="gone", start_pts_ns=38 * NS_PER_S)
    assert alarm_line(run.graph, alarm) == "warning lost at 38.0 s of the stream: gone"
    camera = GRAPH["nodes"]["decode"] | {"input": "rtsp://127.0.0.1:9/1"}  # type: ignore[index]
    graph = Graph.model_validate(GRAPH | {"nodes": {**GRAPH["nodes"], "decode": camera}})
    assert alarm_line(graph, alarm) == "warning lost at 2026-01-14T23:59:58.000Z: gone"
    over = replace(alarm, active=False, end_pts_ns=41 * NS_PER_S)
    assert alarm_line(graph, over) == "lost ended at 2026-01-15T00:00:01.000Z: gone"
    unknown = replace(alarm, header=replace(header, arrival_time_ns=0))
    assert alarm_line(graph, unknown) == "warning lost at 38.0 s of the stream: gone"


def test_what_a_node_said_is_not_said_again_at_its_end(
    run: GraphRun, capsys: pytest.CaptureFixture[str]
) -> None:
    view, node = EventView(run.graph, quiet=False), run.nodes["decode"]
    for node.state, node.detail in (("running", "3 dropped"), ("done", "3 dropped")):
        view.update(node)
    said = [line.partition("s  ")[2] for line in capsys.readouterr().err.splitlines()]
    assert said == ["decode: running 3 dropped", "decode: done"]
    assert view.reported == {"decode": "3 dropped"}
    quiet = EventView(run.graph, quiet=True)
    quiet.update(node)
    assert quiet.reported == {}  # so that the end says it


def test_a_quiet_log_has_failures_and_alarms(
    run: GraphRun, capsys: pytest.CaptureFixture[str]
) -> None:
    view = EventView(run.graph, quiet=True, as_json=True)
    view.started(run)
    run.on_result("lab/cam", Liveness(header=Header(), verdict="live"))
    for severity in ("info", "warning", "alarm"):
        run.on_result("lab/cam", Alarm(header=Header(), kind="lost", severity=severity))
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [(e["level"], e["camera"]) for e in events] == [
        ("info", "cam"), ("warning", "cam"), ("error", "cam"),
    ]  # fmt: skip
