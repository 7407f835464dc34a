"""Metrics of a run: what Prometheus and whoever probes it are told."""

from __future__ import annotations

import contextlib
import http.client
import json
import re
import socket
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import pytest
import yaml
from prometheus_client.parser import text_string_to_metric_families
from run_samples import GRAPH, nobody

from rsenf.config import Graph
from rsenf.errors import RsenfError, UsageError
from rsenf.messages import Header, Health, Liveness
from rsenf.run.graph_run import GraphRun
from rsenf.run.metrics import MOST_REQUESTS, serving_metrics
from rsenf.run.restart_policy import NodeState
from tests.loopback import Loopback


@pytest.fixture
def run() -> GraphRun:
    graph = Graph.model_validate(GRAPH)
    nodes = {n: NodeState(n, config.kind, "running") for n, config in graph.nodes.items()}
    bus = Loopback().bus("supervisor")
    made = GraphRun(graph, "1a2b", "", nodes, lambda node: None, nobody, bus)
    nodes["grid"].state = "done"
    nodes["rows"].starts = 3
    nodes["rows"].health = Health(
        header=Header(), messages_in=70, dropped=3, missed=2, rejected=1, queue_depth=4,
        latency_p50_s=0.25, latency_p95_s=1.5, detail="rtsp://user:hunter2@host/x",
    )  # fmt: skip
    made.latest["live"]["lab/cam"] = Liveness(header=Header(), verdict="stale", since_ns=5 * 10**9)
    made.alarm_counts["lab/cam", "stale"] = 2
    return made


def get(port: int, page: str) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{page}") as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as exc:
        return exc.code, exc.read().decode()


def test_what_prometheus_reads(run: GraphRun) -> None:
    with serving_metrics(run, "0") as port:
        status, text = get(port, "/metrics")
    assert status == 200
    assert "hunter2" not in text
    found = {
        (s.name, tuple(sorted(s.labels.items()))): s.value
        for family in text_string_to_metric_families(text)
        for s in family.samples
    }

    def of_rows(name: str, **more: str) -> float:
        labels = {"node": "rows", "kind": "rows", "camera": "cam", **more}
        return found[name, tuple(sorted(labels.items()))]

    assert of_rows("rsenf_messages_total") == 70
    assert of_rows("rsenf_messages_dropped_total") == 3
    assert of_rows("rsenf_messages_missed_total") == 2
    assert of_rows("rsenf_messages_rejected_total") == 1
    assert of_rows("rsenf_queue_depth") == 4
    assert of_rows("rsenf_restarts_total") == 2
    assert of_rows("rsenf_up") == 1
    assert of_rows("rsenf_latency_seconds", since="arrival", quantile="0.95") == 1.5
    assert not any(dict(at).get("since") == "exposure" for _, at in found)
    assert found["rsenf_alarms_total", (("camera", "lab/cam"), ("kind", "stale"))] == 2
    verdicts = {dict(at)["verdict"]: v for (n, at), v in found.items() if n == "rsenf_verdict"}
    assert [name for name, value in verdicts.items() if value] == ["stale"]


def test_rules_and_dashboard_name_what_there_is(run: GraphRun) -> None:
    with serving_metrics(run, "0") as port:
        families = text_string_to_metric_families(get(port, "/metrics")[1])
    there = {sample.name for family in families for sample in family.samples}
    folder = Path(__file__).parents[2] / "configs/monitoring"
    rules = yaml.safe_load((folder / "rsenf-rules.yaml").read_text(encoding="utf-8"))
    board = json.loads((folder / "grafana.json").read_text(encoding="utf-8"))
    asked = [rule["expr"] for group in rules["groups"] for rule in group["rules"]]
    asked += [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    named = {name for text in asked for name in re.findall(r"rsenf_[a-z_]+", text)}
    assert len(named) > 8
    assert named <= there


def test_alive_and_ready(run: GraphRun) -> None:
    with serving_metrics(run, "127.0.0.1:0") as port:
        assert get(port, "/healthz") == (200, "alive\n")
        assert get(port, "/readyz") == (200, "ready\n")
        run.nodes["track"].behind = "behind by 7 s"
        assert get(port, "/readyz") == (200, "ready\ntrack: behind by 7 s\n")
        run.nodes["track"].state = "restarting"
        assert get(port, "/readyz")[0] == 503
        assert get(port, "/elsewhere")[0] == 404
        with pytest.raises(RsenfError, match="in use"), serving_metrics(run, str(port)):
            pass


def test_a_page_of_another_site_reads_nothing(run: GraphRun) -> None:
    with serving_metrics(run, "0") as port:
        asked = urllib.request.Request(f"http://127.0.0.1:{port}/metrics")
        asked.add_header("Host", f"evil.example:{port}")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(asked)


def test_connections_that_ask_for_nothing_are_cut_off(
    run: GraphRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few hold a thread until their time is over; the others are closed at once."""
    monkeypatch.setattr("rsenf.run.metrics.REQUEST_S", 1.0)
    with serving_metrics(run, "0") as port, contextlib.ExitStack() as stack:
        before = threading.active_count()
        for _ in range(200):
            stack.enter_context(socket.create_connection(("127.0.0.1", port)))
        assert threading.active_count() - before <= 2 * MOST_REQUESTS + 1

        while True:  # the test's own limit ends it
            with contextlib.suppress(OSError, http.client.HTTPException):
                assert get(port, "/healthz") == (200, "alive\n")
                break
            time.sleep(0.1)


def test_no_address(run: GraphRun) -> None:
    with pytest.raises(UsageError, match="HOST:PORT"), serving_metrics(run, "here"):
        pass
