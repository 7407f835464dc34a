"""What a supervisor makes of what nodes say."""

from __future__ import annotations

import pytest
from run_samples import GRAPH, nobody

from rsenf.bus.keys import HEALTH, health_key
from rsenf.config import Graph
from rsenf.messages import Header, Health
from rsenf.run.graph_run import GraphRun
from rsenf.run.restart_policy import NodeState
from tests.loopback import Loopback


class Said:
    """A run, and the nodes' words to it."""

    def __init__(self) -> None:
        graph, network = Graph.model_validate(GRAPH), Loopback()
        self.nodes = {name: NodeState(name, config.kind) for name, config in graph.nodes.items()}
        self.run = GraphRun(graph, "1a2b", "", self.nodes, lambda node: None, nobody)
        self.run.listen_to(network.bus("supervisor"))
        bus = network.bus("nodes")
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


def test_one_that_is_done_early_is_no_failure() -> None:
    said = Said()
    first = next(iter(said.nodes))
    said.say(first, "running")
    said.say(first, "done")
    assert not said.run.never_began
