"""What a supervisor makes of what nodes say."""

from __future__ import annotations

import signal
from typing import Any

import pytest
from run_samples import GRAPH, nobody

from rsenf.bus.keys import HEALTH, SIGNALS, camera_key, health_key
from rsenf.config import Graph
from rsenf.messages import Alarm, Header, Health
from rsenf.run.graph_run import GraphRun
from rsenf.run.restart_policy import NodeState
from tests.loopback import Loopback


class Stubborn:
    """Stands for a process that only SIGKILL ends."""

    def __init__(self) -> None:
        self.pid, self.signals = 1, list[int]()

    def poll(self) -> int | None:
        return -signal.SIGKILL if signal.SIGKILL in self.signals else None

    def send_signal(self, number: int) -> None:
        self.signals.append(number)


class Said:
    """A run, and the nodes' words to it."""

    def __init__(self) -> None:
        graph, network = Graph.model_validate(GRAPH), Loopback()
        self.nodes = {name: NodeState(name, config.kind) for name, config in graph.nodes.items()}
        bus = network.bus("supervisor")
        self.run = GraphRun(graph, "1a2b", "", self.nodes, lambda node: None, nobody, bus)
        self.bus = bus = network.bus("nodes")
        self._words = {n: bus.publisher(health_key(graph.site, n), HEALTH) for n in self.nodes}
        self._said = 0

    def say(self, name: str, state: str) -> None:
        header = Header(run_id="1a2b", seq=self._said)
        self._words[name].send(Health(header=header, node=name, state=state))
        self._said += 1
        self.run.watch(1.0)


@pytest.mark.parametrize("late", [True, False])
def test_one_that_fails_before_all_are_ready_is_waited_for_in_vain(late: bool) -> None:
    said = Said()
    first, *others = said.nodes
    for name in others if late else ():
        said.say(name, "running")
    said.say(first, "running")
    said.say(first, "failed")
    assert said.nodes[first].state == "failed"
    assert said.run.never_began != late


def reloaded(run: GraphRun, nodes: dict[str, Any]) -> None:
    """Exchange the graph, as a reload does."""
    run.graph = Graph.model_validate({**GRAPH, "nodes": nodes})
    run.exchanges.begin(run.graph, run.nodes, run._revival)
    run._subscribe()


def test_one_that_a_reload_has_removed_may_still_live_when_the_run_is_stopped() -> None:
    said = Said()
    decode = said.nodes["decode"]
    decode.process = Stubborn()
    reloaded(said.run, {"rows": GRAPH["nodes"]["rows"]})  # type: ignore[index]
    assert said.run.running == [decode]
    said.run.stop()
    assert decode.process.signals == [signal.SIGTERM, signal.SIGKILL]


def test_nothing_is_kept_of_a_camera_that_a_reload_has_removed() -> None:
    said = Said()
    alarm = Alarm(header=Header(run_id="1a2b"), kind="lost", active=True)
    publisher = said.bus.publisher(camera_key("lab", "cam", "alarm"), SIGNALS)
    publisher.send(alarm)
    said.run.watch(1.0)
    assert said.run.alarm_counts == {("lab/cam", "lost"): 1}
    reloaded(said.run, {"grid": GRAPH["nodes"]["grid"]})  # type: ignore[index]
    publisher.send(alarm)  # still under way
    said.run.watch(1.0)
    assert not any((said.run.alarms, said.run.alarm_counts, said.run.latest["alarm"]))


def test_one_that_comes_back_has_a_number_that_no_start_had_before() -> None:
    started = list[tuple[str, int]]()

    def spawn(node: NodeState) -> Stubborn:
        started.append((node.name, node.restarts))
        return Stubborn()

    graph = Graph.model_validate({**GRAPH, "nodes": {"grid": GRAPH["nodes"]["grid"]}})  # type: ignore[index]
    nodes = {"grid": NodeState("grid", "reference")}
    bus = Loopback().bus("supervisor")
    run = GraphRun(graph, "r", "", nodes, lambda node: None, spawn, bus)  # type: ignore[arg-type]
    run.start()
    for with_it in ({}, {"grid": GRAPH["nodes"]["grid"]}):  # type: ignore[index]
        nodes_now = {"rows": GRAPH["nodes"]["rows"], **with_it}  # type: ignore[index]
        new = Graph.model_validate({**GRAPH, "nodes": nodes_now})
        run.exchanges.begin(new, run.nodes, run._revival)
        run._revival.start_due()
    assert started == [("grid", 0), ("rows", 0), ("grid", 1)]


def test_a_host_that_has_none_can_be_given_nodes() -> None:
    hosts = {"a": {"nodes": list(GRAPH["nodes"]), "address": "tcp/192.0.2.1:7447"}, "b": {}}  # type: ignore[arg-type]
    started, bus = list[str](), Loopback().bus("supervisor")
    graph = Graph.model_validate({**GRAPH, "hosts": hosts})
    run = GraphRun(
        graph, "r", "", {}, lambda node: None, lambda n: started.append(n.name), bus, "b"  # type: ignore[arg-type, func-returns-value]
    )  # fmt: skip
    hosts["b"] = {"nodes": [hosts["a"]["nodes"].pop()]}  # type: ignore[attr-defined]
    new = Graph.model_validate({**GRAPH, "hosts": hosts})
    run.exchanges.begin(new, run.nodes, run._revival)
    run._revival.start_due()
    assert started == ["record"]


def test_one_that_is_done_early_is_no_failure() -> None:
    said = Said()
    first = next(iter(said.nodes))
    said.say(first, "running")
    said.say(first, "done")
    assert not said.run.never_began
