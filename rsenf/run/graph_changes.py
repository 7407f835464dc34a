"""The graph of a run while it goes on: handed to the node processes, and exchanged for another.

The supervisor holds the graph in memory that its nodes inherit. So a node that is started again
gets what the run was started with, or has taken since, whatever stands in the file by then.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rsenf.bus.ring import ring_directory
from rsenf.config import Graph
from rsenf.config.graph import host_of, sender_of
from rsenf.config.node_kind import Stream
from rsenf.errors import UsageError
from rsenf.run.process import set_by_signal
from rsenf.run.restart_policy import NodeState, RestartPolicy

if TYPE_CHECKING:
    from rsenf.run.node import NodeProcess

# What all processes of a run share, and what its bus was opened with.
FIXED = ("site", "bus", "hosts", "tls", "access")


@contextmanager
def _locked(descriptor: int, how: int) -> Iterator[None]:
    fcntl.lockf(descriptor, how)
    try:
        yield
    finally:
        fcntl.lockf(descriptor, fcntl.LOCK_UN)


def hold_graph(descriptor: int, graph: Graph) -> None:
    """Hold a graph for the nodes, in place of the one before."""
    with _locked(descriptor, fcntl.LOCK_EX):
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, pickle.dumps(graph), 0)


def held_graph(descriptor: int) -> Graph:
    """Return the graph that a supervisor holds now."""
    with _locked(descriptor, fcntl.LOCK_SH):
        held = os.pread(descriptor, os.fstat(descriptor).st_size, 0)
    graph: Graph = pickle.loads(held)
    return graph


def take_exchanges(node: NodeProcess, descriptor: int) -> None:
    """Make SIGHUP, which the supervisor has blocked, exchange a node's graph for the held one.

    A node that can't go on in the new graph leaves.

    Parameters
    ----------
    node : NodeProcess
    descriptor : int
        Of the held graph.
    """

    def exchange(_number: int, _frame: object) -> None:
        graph = held_graph(descriptor)
        if node.name in begun_anew(node.graph, graph):
            node.leaving = True
            set_by_signal(node.stop)
        elif node.name in graph.nodes:
            node.graph, node.peers.names = graph, awaited(graph, node.name)

    signal.signal(signal.SIGHUP, exchange)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGHUP})


def awaited(graph: Graph, name: str) -> set[str]:
    """Return the other nodes; external programs, which may have no liveliness token, left out."""
    return {n for n, config in graph.nodes.items() if n != name and not config.program()}


def check_exchange(old: Graph, new: Graph, host: str = "") -> None:
    """Check that a running graph can become another one.

    Parameters
    ----------
    old, new : Graph
    host : str, optional
        Host of the run, in a graph that is split over hosts.

    Raises
    ------
    UsageError
        When a setting differs that only a new run can take.
    RsenfError
        When a node isn't ready to be started.
    """
    for name in FIXED:
        if getattr(old, name) != getattr(new, name) and not (name == "hosts" and _moved(old, new)):
            raise UsageError(f"{name!r} has changed", "that takes a new start of the run")
    for name, config in new.nodes.items():
        if host_of(new, name) == host and old.nodes.get(name) != config:
            config.check_ready(name, new.site)


def _moved(old: Graph, new: Graph) -> bool:
    """Whether the hosts differ in their nodes alone."""

    def links(graph: Graph) -> dict[str, object]:
        return {name: host.model_copy(update={"nodes": ()}) for name, host in graph.hosts.items()}

    return links(old) == links(new)


# In which a node that leaves must have ended: as long as a slow machine has to stop a run.
LEAVE_S = 20.0


class Exchanges:
    """Exchanges the graph of a run for another one, as far as the two differ.

    Parameters
    ----------
    graph : Graph
        The first.
    host : str, optional
        Host of the run, in a graph that is split over hosts.

    Attributes
    ----------
    descriptor : int
        Of a file without a name that holds the graph for the nodes. It may hold passwords: it is in
        memory, where there is such a folder, and goes with its readers.
    count : int
        How often it was exchanged.
    removed : list of NodeState
        Nodes that are not in the graph any more, until they have ended.
    """

    def __init__(self, graph: Graph, host: str = "") -> None:
        self._graph, self._host = graph, host
        self._file = tempfile.TemporaryFile(dir=ring_directory())  # noqa: SIM115 - lives as long
        self.descriptor = self._file.fileno()
        hold_graph(self.descriptor, graph)
        self.count = 0
        self.removed: list[NodeState] = []
        self._past: dict[str, NodeState] = {}  # all that were removed: they may come back
        self._leaving: list[NodeState] = []  # to be started again
        self._end_by_s = 0.0

    @property
    def complete(self) -> bool:
        """Whether all nodes that had to end have ended."""
        return not (self.removed or self._leaving)

    def begin(self, graph: Graph, nodes: dict[str, NodeState], policy: RestartPolicy) -> None:
        """Tell the nodes: some leave, some are new, the others go on.

        Parameters
        ----------
        graph : Graph
            The new one.
        nodes : dict
            State of each node of this host by name; brought in line with the graph.
        policy : RestartPolicy
            Starts nodes.
        """
        old, self._graph = self._graph, graph
        here = [name for name in graph.nodes if host_of(graph, name) == self._host]
        anew = begun_anew(old, graph).intersection(here)
        self.count += 1
        self._end_by_s = time.monotonic() + LEAVE_S
        hold_graph(self.descriptor, graph)
        self.removed = [nodes.pop(name) for name in set(nodes) - set(here)]
        self._past |= {node.name: node for node in self.removed}
        fresh = [name for name in here if name not in nodes]
        for name in fresh:
            nodes[name] = NodeState(name, graph.nodes[name].kind)
            if past := self._past.get(name):
                nodes[name].starts, nodes[name].deaths_s = past.starts, past.deaths_s
        policy.take(graph)
        for node in self.removed:
            node.asked_to_end = True
            node.signal(signal.SIGTERM)
        for name, node in nodes.items():
            node.kind = graph.nodes[name].kind
            runs = node.process is not None and node.exit_code is None
            if name in fresh or (name in anew and not runs):
                policy.begin(node)
            elif name in anew:
                self._leaving.append(node)
            if not (name in old.nodes and old.nodes[name].program()):
                node.signal(signal.SIGHUP)
            elif name in anew:
                node.signal(signal.SIGTERM)
        self.removed = [n for n in self.removed if n.process is not None and n.exit_code is None]

    def kill_late(self) -> None:
        """Kill nodes that should have ended by now."""
        if not self.complete and time.monotonic() > self._end_by_s:
            for node in (*self.removed, *self._leaving):
                node.signal(signal.SIGKILL)

    def ended(self, node: NodeState) -> bool:
        """Note that a node has ended; return whether it isn't in the graph any more."""
        if node not in self.removed:
            return False
        self.removed.remove(node)
        node.state, node.detail = "done", "it is no longer in the graph"
        return True

    def continues(self, node: NodeState) -> bool:
        """Note that a node has ended; return whether it left to be started again."""
        if node not in self._leaving:
            return False
        self._leaving.remove(node)
        return True


def begun_anew(old: Graph, new: Graph) -> set[str]:
    """Return the nodes of both graphs that can't go on as they are.

    These are nodes whose settings or senders have changed. A node that reads one of them goes on:
    the streams don't end, they continue as those of a restarted node. Only an external program
    ends its streams, so its readers begin anew, too.

    Parameters
    ----------
    old, new : Graph
    """
    both = old.nodes.keys() & new.nodes.keys()
    found = {
        name
        for name in both
        if old.nodes[name] != new.nodes[name]
        or old.environment_of(name) != new.environment_of(name)
        or host_of(old, name) != host_of(new, name)
        or _senders(old, name) != _senders(new, name)
        or (new.nodes[name].shows_all and old != new)
    }
    before: set[str] = set()
    while found != before:
        before = set(found)
        ends = {name for name in found if new.nodes[name].program()}
        found |= {name for name in both if ends & set(_senders(new, name).values())}
    return found


def in_words(old: Graph, new: Graph) -> str:
    """Return what an exchange of graphs changes, in one line."""
    parts = {
        "removed": sorted(old.nodes.keys() - new.nodes.keys()),
        "new": sorted(new.nodes.keys() - old.nodes.keys()),
        "started again": sorted(begun_anew(old, new)),
    }
    said = [f"{what} {', '.join(names)}" for what, names in parts.items() if names]
    return "; ".join(said) or "no node has changed"


def _senders(graph: Graph, name: str) -> dict[Stream, str]:
    """Return the sender of each stream that a node reads."""
    reads = graph.inputs_of(graph.nodes[name])
    return {read.stream: sender_of(graph, *read.stream) for read in reads}
