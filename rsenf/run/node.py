"""What every node process does beside its stage: config, bus, health, signals, last words."""

from __future__ import annotations

import argparse
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from rsenf.bus.delivery import HEALTH, Delivery, delivery_of
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import alive_key, camera_key, health_key, node_of, reference_key, topic_of
from rsenf.bus.zenoh_bus import BusSettings, Publisher, ZenohBus, open_bus
from rsenf.config import Graph, load_graph, redact
from rsenf.config.graph import sender_of
from rsenf.errors import EXIT_INTERRUPTED, NodeFailed, RsenfError
from rsenf.messages import Header, Health
from rsenf.run.peers import Peers

HEALTH_EVERY_S = 1.0
PEERS_TIMEOUT_S = 30.0


class NodeProcess:
    """One node of a graph, in its own process.

    Parameters
    ----------
    graph : Graph
        The whole graph, so that the node knows who feeds it.
    name : str
        Its own name in the graph.
    run_id : str
        Identity of the run, carried by every message.
    bus : ZenohBus
        Open bus.
    """

    def __init__(self, graph: Graph, name: str, run_id: str, bus: ZenohBus) -> None:
        self.graph, self.name, self.run_id = graph, name, run_id
        self.config: Any = graph.nodes[name]
        self.graph_text = ""
        self.stop = threading.Event()
        self.inbox = Inbox()
        self.peers = Peers(set(graph.nodes) - {name})
        self.exit_code = 0
        self._bus = bus
        self._publishers: list[Publisher] = []
        self._state, self._detail = "starting", ""
        self._seq = 0
        self._last_input_ns = 0
        self._latency_s = 0.0
        self._rate = _Rate()
        self._health = bus.publisher(health_key(graph.site, name), HEALTH)
        self._watch_peers()
        threading.Thread(target=self._beat, name="health", daemon=True).start()

    # --- the streams -----------------------------------------------------------------------

    def publisher(self, camera: str, topic: str, *, live: bool = False) -> Publisher:
        """Open a camera's topic for sending."""
        return self._open(camera_key(self.graph.site, camera, topic), delivery_of(topic, live=live))

    def reference_publisher(self, grid: str) -> Publisher:
        """Open a grid's reference for sending."""
        return self._open(reference_key(self.graph.site, grid), delivery_of("reference"))

    def _open(self, key: str, delivery: Delivery) -> Publisher:
        publisher = self._bus.publisher(key, delivery)
        self._publishers.append(publisher)
        return publisher

    def subscribe(self, key_expr: str, delivery: Delivery | None = None) -> str:
        """Let the inbox receive a key expression; returns it."""
        self._bus.subscribe(self.inbox, key_expr, delivery or delivery_of(topic_of(key_expr)))
        return key_expr

    def sender_of(self, topic: str, name: str) -> str:
        """Node of this graph that sends a camera's topic or a grid's reference; '' for none."""
        return sender_of(self.graph, topic, name)

    def ready(self) -> None:
        """Subscriptions are open: show it. Senders wait for this."""
        self._bus.declare_alive(alive_key(self.graph.site, self.name))
        self.say("running")

    def wait_for_peers(self) -> None:
        """Wait until all other nodes of the graph listen, so that nothing is sent into the void.

        Raises
        ------
        NodeFailed
            When some never come.
        """
        missing = self.peers.wait_for_all(PEERS_TIMEOUT_S, self.stop)
        if missing and not self.stop.is_set():
            raise NodeFailed(f"never came up: {', '.join(sorted(missing))}", "is it started?")

    def note_input(self, header: Header) -> None:
        """Count a message received and the time it took from the frame's arrival to here."""
        self._last_input_ns = time.time_ns()
        self._rate.count()
        if header.arrival_time_ns:
            self._latency_s = (self._last_input_ns - header.arrival_time_ns) / 1e9

    # --- health ----------------------------------------------------------------------------

    def say(self, state: str, detail: str = "") -> None:
        """Change the state, and publish it at once."""
        self._state, self._detail = state, redact(detail)
        self._publish_health()

    def _watch_peers(self) -> None:
        site, words = self.graph.site, Inbox()
        self._bus.watch_alive(alive_key(site, "*"), self.peers.on_alive)
        self._bus.subscribe(words, health_key(site, "*"), HEALTH)

        def listen() -> None:
            while not words.closed:
                received = words.receive(1.0)
                if received:
                    self.peers.on_state(node_of(received.key), received.message.state)

        threading.Thread(target=listen, name="peers", daemon=True).start()

    def _beat(self) -> None:
        parent, last = os.getppid(), 0.0
        before: tuple[str, ...] = ()
        while not self.stop.wait(0.1):
            if os.getppid() != parent:  # whoever started the graph is gone: don't linger
                self.stop.set()
            lost = self.peers.lost
            if lost != before or time.monotonic() - last >= HEALTH_EVERY_S:
                before, last = lost, time.monotonic()
                self._publish_health()

    def _publish_health(self) -> None:
        counters, process = self.inbox.counters, psutil.Process()
        usage = process.cpu_times()
        self._seq += 1
        self._health.send(
            Health(
                header=Header(
                    run_id=self.run_id,
                    source=self.name,
                    seq=self._seq,
                    arrival_time_ns=time.time_ns(),
                ),
                node=self.name,
                kind=self.config.kind,
                state=self._state,
                detail=self._detail,
                pid=os.getpid(),
                host=socket.gethostname(),
                time_ns=time.time_ns(),
                messages_in=counters.received,
                messages_out=sum(p.sent for p in self._publishers),
                dropped=counters.dropped,
                missed=counters.missed,
                rejected=counters.rejected,
                rate_hz=self._rate.per_s(),
                queue_depth=self.inbox.depth,
                latency_s=self._latency_s,
                last_input_ns=self._last_input_ns,
                lost_peers=self.peers.lost,
                memory_bytes=process.memory_info().rss,
                cpu_s=usage.user + usage.system,
            )
        )


class _Rate:
    """Messages a second, smoothed over a few seconds."""

    def __init__(self) -> None:
        self._count, self._since, self._value = 0, time.monotonic(), 0.0

    def count(self) -> None:
        self._count += 1

    def per_s(self) -> float:
        now = time.monotonic()
        if now - self._since >= HEALTH_EVERY_S:
            fresh = self._count / (now - self._since)
            self._value = 0.5 * (self._value + fresh) if self._value else fresh
            self._count, self._since = 0, now
        return self._value


def run_node(body: Callable[[NodeProcess], None]) -> int:
    """Run a node from its command line; returns the exit code.

    Parameters
    ----------
    body : callable
        Opens the node's streams and loops over its stage until done or ``node.stop`` is set.
    """
    parser = argparse.ArgumentParser(description="one node of an rsenf graph")
    parser.add_argument("--graph", type=Path, required=True)
    parser.add_argument("--node", required=True)
    parser.add_argument("--connect", action="append", default=[], help="endpoint of the bus")
    parser.add_argument("--run-id", default="")
    args = parser.parse_args()
    try:
        graph = load_graph(args.graph)
        if args.node not in graph.nodes:
            raise RsenfError(f"no node {args.node!r} in {args.graph}")
        with open_bus(bus_settings(graph, tuple(args.connect))) as bus:
            node = NodeProcess(graph, args.node, args.run_id, bus)
            node.graph_text = redact(args.graph.read_text(encoding="utf-8"))
            _install_signals(node)
            return _live(node, body)
    except RsenfError as exc:
        print(f"rsenf: {args.node}: {redact(str(exc))}", file=sys.stderr)
        return exc.exit_code


def _live(node: NodeProcess, body: Callable[[NodeProcess], None]) -> int:
    try:
        body(node)
    except RsenfError as exc:
        node.say("failed", str(exc))
        raise
    except Exception as exc:
        node.say("failed", f"{type(exc).__name__}: {exc}")
        raise
    node.say("done", node._detail)
    node.stop.set()
    return node.exit_code


def bus_settings(graph: Graph, connect: tuple[str, ...]) -> BusSettings:
    """How a node reaches the graph's bus: the run's own router, or what the graph names."""
    bus = graph.bus
    return BusSettings(
        mode="client" if connect else bus.mode,
        connect=connect or bus.connect,
        multicast=bus.multicast and not connect,
        zenoh=bus.zenoh,
    )


def _install_signals(node: NodeProcess) -> None:
    def stop(_signum: int, _frame: Any) -> None:
        if node.stop.is_set():
            os._exit(EXIT_INTERRUPTED)
        node.stop.set()

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
