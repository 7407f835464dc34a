"""Starts the processes of a graph, watches them, and stops them cleanly."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsenf.bus.delivery import HEALTH
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import camera_key, health_key, node_of
from rsenf.bus.ring import ring_directory
from rsenf.bus.zenoh_bus import BusSettings, ZenohBus, open_bus
from rsenf.config import Graph
from rsenf.config.graph import DecodeNode, MatchNode, ReferenceNode
from rsenf.errors import NodeFailed
from rsenf.messages import Health, MatchResult

# Told to stop, sources end their streams and everything after them finishes by itself; who hasn't
# by then is told too, and in the end made to.
SOURCES_FIRST_S = 0.9
KILL_AFTER_S = 1.7
POLL_S = 0.05

# Threads of the numerical libraries fight each other for the same cores.
_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_LOG_LEVEL": "ERROR",
}


@dataclass
class NodeState:
    """What the supervisor knows of a node."""

    name: str
    kind: str
    state: str = "starting"
    detail: str = ""
    health: Health | None = None
    process: subprocess.Popen[bytes] | None = None
    exit_code: int | None = None


@dataclass
class GraphRun:
    """A running graph.

    Parameters
    ----------
    graph : Graph
        What is run.
    nodes : dict
        State of each node by name.
    endpoint : str
        Where others can join the bus.
    """

    graph: Graph
    run_id: str
    endpoint: str
    nodes: dict[str, NodeState]
    on_change: Callable[[NodeState], None]
    results: dict[str, MatchResult] = field(default_factory=dict)
    _words: Inbox = field(default_factory=Inbox)

    @property
    def running(self) -> list[NodeState]:
        """Nodes whose processes live."""
        return [n for n in self.nodes.values() if n.process and n.exit_code is None]

    def wait(self, stop: threading.Event) -> None:
        """Watch until every process has ended, or ``stop`` is set."""
        while self.running and not stop.is_set():
            self.watch(POLL_S)
        if stop.is_set():
            self.stop()
        self._listen_until_quiet()

    def watch(self, timeout_s: float) -> None:
        """Take in what the nodes say, and see which have ended."""
        self._listen(timeout_s)
        for node in self.running:
            assert node.process is not None
            code = node.process.poll()
            if code is not None:
                self._listen_until_quiet()
                node.exit_code = code
                if code < 0:
                    self._change(node, "lost", f"killed by signal {-code}")
                elif code == 0 or node.state == "done":
                    self._change(node, "done", node.detail)
                else:
                    self._change(node, "failed", node.detail or f"exit code {code}")

    def stop(self) -> None:
        """Stop everything within two seconds: sources first, so that their streams end in order."""
        begun = time.monotonic()
        for node in self.running:
            if isinstance(self.graph.nodes[node.name], DecodeNode | ReferenceNode):
                _signal(node, signal.SIGTERM)
        self._wait_until(begun + SOURCES_FIRST_S)
        for node in self.running:
            _signal(node, signal.SIGTERM)
        self._wait_until(begun + KILL_AFTER_S)
        for node in self.running:
            _signal(node, signal.SIGKILL)
        self._wait_until(begun + KILL_AFTER_S + 1.0)

    def kill(self) -> None:
        """End every process at once."""
        for node in self.running:
            _signal(node, signal.SIGKILL)
        for node in self.running:
            if node.process:
                node.process.wait()

    def _wait_until(self, deadline: float) -> None:
        while self.running and time.monotonic() < deadline:
            self.watch(POLL_S)

    def _listen_until_quiet(self) -> None:
        while self._listen(POLL_S):
            pass

    def _listen(self, timeout_s: float) -> bool:
        received = self._words.receive(timeout_s)
        if received is None:
            return False
        if isinstance(received.message, Health):
            node = self.nodes.get(node_of(received.key))
            if node is not None and node.exit_code is None:
                node.health = received.message
                self._change(node, received.message.state, received.message.detail)
        elif not received.message.header.is_end:
            self.results[received.message.header.source] = received.message
        return True

    def _change(self, node: NodeState, state: str, detail: str) -> None:
        before = node.state, node.detail
        node.state, node.detail = state, detail
        if before != (state, detail):
            self.on_change(node)

    def listen_to(self, bus: ZenohBus) -> None:
        """Subscribe to the health of the nodes, and to results."""
        site = self.graph.site
        bus.subscribe(self._words, health_key(site, "*"), HEALTH)
        for match in self.graph.of(MatchNode):
            for camera in match.cameras:
                bus.subscribe(self._words, camera_key(site, camera, "match"), HEALTH)


@contextmanager
def start_graph(
    graph: Graph, path: Path, on_change: Callable[[NodeState], None] = lambda node: None
) -> Iterator[GraphRun]:
    """Start every node of a graph as a process, for the duration of a ``with`` block.

    Parameters
    ----------
    graph : Graph
        The graph, already checked.
    path : Path
        Its file, which every node reads again.
    on_change : callable, optional
        Told of every change of a node's state.

    Raises
    ------
    RsenfError
        When the bus can't be opened.
    """
    run_id = secrets.token_hex(4)
    own_router = not graph.bus.connect
    settings = (
        _own_router(graph)
        if own_router
        else BusSettings(mode=graph.bus.mode, connect=graph.bus.connect, zenoh=graph.bus.zenoh)
    )
    with open_bus(settings) as bus:
        endpoint = (settings.listen if own_router else settings.connect)[0]
        nodes = {name: NodeState(name, config.kind) for name, config in graph.nodes.items()}
        run = GraphRun(graph, run_id, endpoint, nodes, on_change)
        run.listen_to(bus)
        try:
            for node in nodes.values():
                node.process = _spawn(node, path, run_id, endpoint if own_router else "")
            yield run
        finally:
            if run.running:
                run.stop()
            run.kill()
            for ring in ring_directory().glob(f"rsenf-{run_id}-*"):
                ring.unlink(missing_ok=True)


def _own_router(graph: Graph) -> BusSettings:
    listen = graph.bus.listen or (f"tcp/127.0.0.1:{_free_port()}",)
    return BusSettings(mode="router", listen=listen, zenoh=graph.bus.zenoh)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _spawn(node: NodeState, path: Path, run_id: str, endpoint: str) -> subprocess.Popen[bytes]:
    command: list[Any] = [
        sys.executable,
        "-m",
        f"rsenf_nodes.{node.kind}",
        "--graph",
        path,
        "--node",
        node.name,
        "--run-id",
        run_id,
    ]
    if endpoint:
        command += ["--connect", endpoint]
    try:
        # A session of its own: Ctrl-C reaches the supervisor only, which stops them in order.
        return subprocess.Popen(
            command,
            env={**os.environ, **_ENVIRONMENT},
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError as exc:
        raise NodeFailed(f"node {node.name} can't be started: {exc}") from exc


def _signal(node: NodeState, number: signal.Signals) -> None:
    if node.process:
        with contextlib.suppress(ProcessLookupError):
            node.process.send_signal(number)


def check_ended(run: GraphRun) -> int:
    """Exit code of a graph that has ended: the worst of its nodes'.

    Raises
    ------
    NodeFailed
        When a node was lost or failed.
    """
    bad = [n for n in run.nodes.values() if n.state in ("lost", "failed")]
    if bad:
        raise NodeFailed("; ".join(f"{n.name}: {n.detail}" for n in bad))
    return max((n.exit_code or 0 for n in run.nodes.values()), default=0)
