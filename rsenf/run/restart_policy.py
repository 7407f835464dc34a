"""Restart policy and watchdog: nodes that died are started again, nodes that are silent are ended.

A node is started again after a growing pause, so many times within so long.
"""

from __future__ import annotations

import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping

from rsenf.config import Graph
from rsenf.config.node_kind import Restart
from rsenf.errors import EXIT_USAGE
from rsenf.run.node_state import NodeState

# Until its first word a node may take this long: it loads libraries, on a machine that is busy.
FIRST_WORD_S = 60.0


class Restarts:
    """Restarts of one node.

    Parameters
    ----------
    rule : Restart, optional
        The rule; without, a node is never started again.
    """

    def __init__(self, rule: Restart | None) -> None:
        self.rule = rule
        self.count = 0
        self._deaths: deque[float] = deque()

    def pause_s(self, now_s: float, exit_code: int) -> float | None:
        """Take in a death; return the pause until it is started again, or None when it isn't.

        Parameters
        ----------
        now_s : float
            Time of the death by a steady clock.
        exit_code : int
            What is wrongly set up stays so, however often it is tried.
        """
        if self.rule is None or exit_code == EXIT_USAGE:
            return None
        while self._deaths and now_s - self._deaths[0] > self.rule.within_s:
            self._deaths.popleft()
        if len(self._deaths) >= self.rule.limit:
            return None
        pause_s = self.rule.backoff_s * 2.0 ** min(len(self._deaths), 30)
        self._deaths.append(now_s)
        self.count += 1
        return float(min(pause_s, self.rule.backoff_max_s))

    def of(self) -> str:
        """Which one this is, of how many, in words."""
        assert self.rule is not None
        return f"{len(self._deaths)} of {self.rule.limit} within {self.rule.within_s:g} s"


# The supervisor itself may have been held up, and with it what it hears.
HELD_UP_S = 1.0
Spawn = Callable[[NodeState], "subprocess.Popen[bytes]"]


class RestartPolicy:
    """What a supervisor does about nodes that die or hang.

    Parameters
    ----------
    graph : Graph
        With the rules.
    nodes : mapping
        State of each node by name.
    spawn : callable
        Starts a node's process.
    clock : callable, optional
        A steady clock, in seconds.
    """

    def __init__(
        self,
        graph: Graph,
        nodes: Mapping[str, NodeState],
        spawn: Spawn,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._graph, self._nodes, self._spawn, self._clock = graph, nodes, spawn, clock
        self._restarts = {name: Restarts(graph.restart_of(name)) for name in graph.nodes}
        self._due: dict[str, float] = {}
        self._heard: dict[str, float] = {}
        self._looked_s = clock()

    @property
    def due(self) -> list[NodeState]:
        """Nodes that wait to be started again."""
        return [self._nodes[name] for name in self._due]

    def start(self, node: NodeState) -> None:
        """Start a node's process."""
        node.process, node.exit_code, node.told = self._spawn(node), None, False
        self._heard[node.name] = self._clock() + FIRST_WORD_S

    def heard(self, name: str) -> None:
        """Take in that a node has said something."""
        self._heard[name] = self._clock()

    def plan(self, node: NodeState, exit_code: int) -> str:
        """Take in a death; return in words when it is started again, '' when it isn't."""
        restarts, now_s = self._restarts[node.name], self._clock()
        pause_s = restarts.pause_s(now_s, exit_code)
        if pause_s is None:
            return ""
        self._due[node.name] = now_s + pause_s
        return f"started again in {pause_s:g} s, {restarts.of()}"

    def start_due(self) -> list[NodeState]:
        """Start those whose pause is over; returns them.

        A grid's reference that was sent whole, and whose node has ended, is sent once more to a
        node that needs it: the one that died has taken it along.
        """
        now_s = self._clock()
        started = [self._nodes[name] for name, due_s in self._due.items() if due_s <= now_s]
        for node in started:
            del self._due[node.name]
            node.restarts = self._restarts[node.name].count
        read = {i.stream for node in started for i in self._graph.nodes[node.name].inputs()}
        for name, config in self._graph.nodes.items():
            if config.sends_again and not read.isdisjoint(config.outputs()):
                sender = self._nodes.get(name)  # None: on another host
                if sender and sender.state == "done" and sender.exit_code is not None:
                    sender.restarts += 1
                    started.append(sender)
        for node in started:
            self.start(node)
        return started

    def forget(self) -> list[NodeState]:
        """Start none of them any more; returns those that waited for it."""
        waiting = self.due
        self._due.clear()
        return waiting

    def kill_hung(self) -> NodeState | None:
        """Kill the node that has been silent for too long, and longest; returns it.

        One that hangs makes those wait that send to it, and they fall silent after it. So only
        the first is killed, and the others get their time anew.
        """
        now_s = self._clock()
        held_up_s, self._looked_s = now_s - self._looked_s, now_s
        if held_up_s > HELD_UP_S:
            self._heard = {name: heard_s + held_up_s for name, heard_s in self._heard.items()}
        hung = [n for n in self._nodes.values() if self._over_s(n, now_s) > 0]
        if not hung:
            return None
        first = min(hung, key=lambda node: self._heard[node.name])
        first.signal(signal.SIGKILL)
        self._heard = {name: max(heard_s, now_s) for name, heard_s in self._heard.items()}
        self._heard[first.name] = float("inf")
        return first

    def _over_s(self, node: NodeState, now_s: float) -> float:
        """Seconds that a living node has been silent beyond what it may."""
        rule = self._restarts[node.name].rule
        if rule is None or node.process is None or node.exit_code is not None:
            return -1.0
        if self._graph.nodes[node.name].program() and node.health is None:
            return -1.0  # it has never said that it would
        return now_s - self._heard[node.name] - rule.silent_s
