"""Starts the node processes of a graph and the router between them, and ends them all."""

from __future__ import annotations

import contextlib
import os
import secrets
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rsenf.bus.zenoh_bus import MANY_LINKS, ONE_LINK, RUNTIME, BusSettings, free_endpoint, open_bus
from rsenf.config import Graph
from rsenf.config.graph import host_of
from rsenf.errors import NodeFailed, UsageError
from rsenf.run.access import secured
from rsenf.run.fork_server import ForkedProcess, ForkServer, Process
from rsenf.run.graph_run import GraphRun, check_ended
from rsenf.run.heartbeat import PIPE, Heartbeat, name_of_pipe
from rsenf.run.node import bus_settings
from rsenf.run.restart_policy import NodeState

__all__ = ["GraphRun", "NodeState", "check_ended", "start_graph"]

# Several processes with multi-threaded numerical libraries would compete for the same cores.
_ENVIRONMENT = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENCV_LOG_LEVEL": "ERROR",
}
_END_TIMEOUT_S = 5.0


@contextmanager
def start_graph(
    graph: Graph,
    path: Path,
    on_change: Callable[[NodeState], None] = lambda node: None,
    host: str = "",
) -> Iterator[GraphRun]:
    """Start the nodes of a graph as processes, for the duration of a ``with`` block.

    Parameters
    ----------
    graph : Graph
        The validated graph.
    path : Path
        Its file, by which its processes can be told from others.
    on_change : callable, optional
        Called with a node at every change of its state.
    host : str, optional
        Host of the graph whose nodes are started; a host without nodes runs a router only. Empty
        for a graph that isn't split over hosts.

    Raises
    ------
    UsageError
        When the graph has no such host, or needs one.
    RsenfError
        When the bus can't be opened, or a recording can't be played; no node was started then.
    """
    check_host(graph, host)
    here = {name: node for name, node in graph.nodes.items() if host_of(graph, name) == host}
    for name, config in here.items():
        config.check_ready(name, graph.site)
    run_id = secrets.token_hex(4)
    own_router = () if graph.bus.is_elsewhere else graph.bus.listen or (free_endpoint(),)
    settings = router_settings(graph, own_router, host) if own_router else bus_settings(graph)
    environment = _ENVIRONMENT | _threads(own_router, graph.bus.zenoh)
    modules = sorted({type(config).__module__ for config in here.values()})
    with ForkServer(modules, environment, _printed_to()) as server, open_bus(settings) as bus:
        endpoint = next(iter((*own_router, *settings.connect)), "multicast")
        nodes = {name: NodeState(name, config.kind) for name, config in here.items()}

        def spawn(node: NodeState) -> Process:
            is_late = node.restarts or run.exchanges.count
            gone = [n.name for n in nodes.values() if is_late and n.state == "done"]
            if program := run.graph.nodes[node.name].program():
                return _start(node, program, _node_environment(run.graph, node, endpoint, run_id))
            held = run.exchanges.descriptor
            return _spawn(server, node, path, run_id, own_router[:1], held, gone)

        run = GraphRun(graph, run_id, endpoint, nodes, on_change, spawn, bus, host)
        try:
            run.start()
            yield run
        finally:
            # An orderly stop even after an error, so that recordings are closed.
            try:
                run.stop()
            finally:
                run.kill()
            for node in run.running:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    assert node.process is not None
                    node.process.wait(_END_TIMEOUT_S)


def check_host(graph: Graph, host: str) -> None:
    """Check that a graph has this host, or needs none when it is empty.

    Raises
    ------
    UsageError
        When it doesn't.
    """
    if host and host not in graph.hosts:
        known = ", ".join(graph.hosts)
        raise UsageError(f"no host {host!r} in this graph", f"one of {known}" if known else "")
    if graph.hosts and not host:
        raise UsageError("the graph is split over hosts", f"--host {'|'.join(graph.hosts)}")


def router_settings(graph: Graph, own: tuple[str, ...], host: str) -> BusSettings:
    """Return the settings of a run's own router, for its nodes and the routers of other hosts.

    Parameters
    ----------
    graph : Graph
        The graph.
    own : tuple of str
        Endpoints for the nodes.
    host : str
        Host of the graph; '' if it isn't split over hosts.
    """
    zenoh = graph.bus.zenoh
    if not host:
        return BusSettings(mode="router", listen=own, zenoh=zenoh)
    this = graph.hosts[host]
    addresses = (graph.hosts[other].address for other in this.links)
    return BusSettings(
        mode="router",
        listen=(*own, *(this.listen or filter(None, (this.address,)))),
        connect=tuple(filter(None, addresses)),
        zenoh={**secured(graph, host), **zenoh},
    )


def _threads(router: tuple[str, ...], zenoh: Mapping[str, Any]) -> dict[str, str]:
    """Return Zenoh's thread setting for nodes with one link, unless the user has chosen another."""
    chosen = zenoh or os.environ.get(RUNTIME, MANY_LINKS) != MANY_LINKS
    return {RUNTIME: ONE_LINK} if router and not chosen else {}


def _spawn(
    server: ForkServer,
    node: NodeState,
    path: Path,
    run_id: str,
    router: tuple[str, ...],
    held: int,
    gone: Sequence[str],
) -> ForkedProcess:
    command = ["rsenf_nodes", "--graph", str(path), "--node", node.name]
    command += ["--run-id", run_id, "--held", str(held), "--restarts", str(node.restarts)]
    command += [word for name in gone for word in ("--gone", name)]
    for endpoint in router:
        command += ["--connect", endpoint]
    node.heartbeat = Heartbeat()
    try:
        with node.heartbeat.inherited() as writer:
            return server.start([*command, "--heartbeat", str(writer)], [held, writer])
    except OSError as exc:
        raise _not_started(node, exc) from exc


def _node_environment(graph: Graph, node: NodeState, endpoint: str, run_id: str) -> dict[str, str]:
    """Return the environment variables for an external program."""
    config = graph.nodes[node.name]
    return {
        "RSENF_CONNECT": endpoint,
        "RSENF_SITE": graph.site,
        "RSENF_NODE": node.name,
        "RSENF_RUN_ID": run_id,
        "RSENF_RESTARTS": str(node.restarts),
        "RSENF_READS": " ".join(str(read.stream) for read in config.inputs()),
        "RSENF_SENDS": " ".join(map(str, config.outputs())),
    }


def _start(
    node: NodeState, command: list[str], environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    node.heartbeat = Heartbeat(is_sent=False)
    try:
        # A new session: Ctrl-C reaches only the supervisor, which stops the nodes in order.
        with node.heartbeat.inherited() as writer:
            return subprocess.Popen(
                command,
                env={**os.environ, **_ENVIRONMENT, **environment, PIPE: name_of_pipe(writer)},
                stdin=subprocess.DEVNULL,
                stdout=_printed_to(),
                start_new_session=True,
                pass_fds=[writer],
            )
    except OSError as exc:
        raise _not_started(node, exc) from exc


def _not_started(node: NodeState, exc: OSError) -> NodeFailed:
    return NodeFailed(f"node {node.name} can't be started: {exc}")


def _printed_to() -> int | None:
    """Return the descriptor of ``sys.stdout``, which need not be 1: see ``refusals``."""
    with contextlib.suppress(OSError, ValueError, AttributeError):  # no stdout, or not a file
        return sys.stdout.fileno()
    return None
