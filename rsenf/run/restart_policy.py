"""Restart policy and watchdog: restarts nodes that died, kills nodes that hang.

Restarts have exponential backoff, and a limit on their number within a sliding time window.
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

# Extra time until a node's first health message: loading libraries is slow on a busy machine.
FIRST_WORD_S = 60.0


class Restarts:
    """Restart counter of one node.

    Parameters
    ----------
    rule : Restart or None
        Its rule; without one, a node is never restarted.
    """

    def __init__(self, rule: Restart | None) -> None:
        self.rule = rule
        self.count = 0
        self._deaths: deque[float] = deque()

    def pause_s(self, now_s: float, exit_code: int) -> float | None:
        """Note a death; return the pause (s) before the restart, or None for no restart.

        Parameters
        ----------
        now_s : float
            Time of the death by a monotonic clock.
        exit_code : int
            After a usage error there is no restart: it would only repeat the error.
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
        """Return the number of this restart and its limit, in words."""
        assert self.rule is not None
        return f"{len(self._deaths)} of {self.rule.limit} within {self.rule.within_s:g} s"


# A longer gap between two checks means that the supervisor itself was held up; it is not counted
# as silence of the nodes.
HELD_UP_S = 1.0
Spawn = Callable[[NodeState], "subprocess.Popen[bytes]"]


class RestartPolicy:
    """Restarts nodes that died and kills nodes that hang.

    Parameters
    ----------
    graph : Graph
        Holds the restart rules.
    nodes : mapping
        State of each node by name.
    spawn : callable
        Starts a node's process.
    clock : callable, optional
        A monotonic clock, in seconds.
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
        """Nodes that wait to be restarted."""
        return [self._nodes[name] for name in self._due]

    def start(self, node: NodeState) -> None:
        """Start a node's process."""
        node.process, node.exit_code, node.told = self._spawn(node), None, False
        self._heard[node.name] = self._clock() + FIRST_WORD_S

    def heard(self, name: str) -> None:
        """Note a health message of a node."""
        self._heard[name] = self._clock()

    def plan(self, node: NodeState, exit_code: int) -> str:
        """Schedule the restart of a node that died.

        Returns
        -------
        str
            When it is restarted, in words; empty for no restart.
        """
        restarts, now_s = self._restarts[node.name], self._clock()
        pause_s = restarts.pause_s(now_s, exit_code)
        if pause_s is None:
            return ""
        self._due[node.name] = now_s + pause_s
        return f"started again in {pause_s:g} s, {restarts.of()}"

    def start_due(self) -> list[NodeState]:
        """Start the nodes whose pause is over; return them.

        Where a restarted node reads a grid's reference whose sender is done, the sender is started
        once more as well: the reference was lost with the process that died.
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
        """Cancel all restarts; return the nodes that waited for one."""
        waiting = self.due
        self._due.clear()
        return waiting

    def kill_hung(self) -> NodeState | None:
        """Kill the node that has been silent longest, if beyond its limit; return it.

        A hanging node blocks its senders by backpressure, so that they fall silent after it. So
        only the first is killed, and the time limits of all others start anew.
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
        """Return the seconds that a running node has been silent beyond its limit."""
        rule = self._restarts[node.name].rule
        if rule is None or node.process is None or node.exit_code is not None:
            return -1.0
        if self._graph.nodes[node.name].program() and node.health is None:
            return -1.0  # an external program that has never sent health
        return now_s - self._heard[node.name] - rule.silent_s
