"""The process of a node, apart from its stage: config, bus, health, peers, signals, shutdown."""

from __future__ import annotations

import argparse
import contextlib
import os
import secrets
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NoReturn

from rsenf.bus.bus import Bus, Publisher
from rsenf.bus.inbox import CallbackInbox, Inbox
from rsenf.bus.keys import (
    LOOKING,
    REFERENCE,
    SILENT_S,
    Delivery,
    alive_key,
    delivery_of,
    health_key,
    matches,
    node_of,
    start_suffix,
    topic_key,
    topic_of,
    word_key,
)
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import Graph, load_graph
from rsenf.config.graph import elsewhere, readers_of, sender_of, source_waits
from rsenf.config.node_kind import Stream
from rsenf.errors import (
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    EXIT_LOSS,
    NodeFailed,
    RsenfError,
    UsageError,
)
from rsenf.messages import Health
from rsenf.run.graph_changes import awaited, held_graph, take_exchanges
from rsenf.run.health import HealthReport
from rsenf.run.heartbeat import BEAT_S, beating, regularly
from rsenf.run.log import complain
from rsenf.run.peers import Peers
from rsenf.run.process import Patience, end_process, keep_heap, set_by_signal

PATIENCE_S = 3.0
SENDS_AGAIN_S = 2.0
LATE_S = 1.5  # health is sent every second
STAYS_S = 60.0  # for readers that are being restarted


class NodeProcess:
    """One node of a graph, in its own process.

    Parameters
    ----------
    graph : Graph
        The whole graph, which tells the senders of the node's inputs.
    name : str
        Name of this node in the graph.
    run_id : str
        Identity of the run, carried by every message.
    bus : Bus
        Open bus.
    restarts : int
        Number of earlier starts of the node in this run.
    gone : sequence of str
        Nodes of the graph that have already ended.

    Attributes
    ----------
    outputs : list of Publisher
        Those opened so far.
    """

    def __init__(
        self,
        graph: Graph,
        name: str,
        run_id: str,
        bus: Bus,
        restarts: int = 0,
        gone: Sequence[str] = (),
    ) -> None:
        self.graph, self.name, self.run_id, self.restarts = graph, name, run_id, restarts
        self.config: Any = graph.nodes[name]
        self._sends = set(self.config.outputs())
        self._newest: dict[str, str] = {}  # summary of each camera's newest message
        self.stop = threading.Event()
        self.inbox = Inbox(round(graph.bus.largest_mb * 1e6))
        far = elsewhere(graph, name)
        returning = far.union(n for n in graph.nodes if graph.restart_of(n))
        external = {n for n, config in graph.nodes.items() if config.program()}
        self.peers = Peers(awaited(graph, name), returning, gone)
        self.exit_code = 0
        self.leaving = False  # to be started again: no END marks
        self._bus = bus
        self.outputs: list[Publisher] = []
        self._recovers: list[str] = []  # key expressions whose missing messages are requested
        self._health = HealthReport(self, bus)
        self.say, self.show = self._health.say, self._health.show
        self.count_waiting = self._health.count_waiting
        self.note_input, self.note_cut_off = self._health.note_input, self._health.note_cut_off
        self._watch_peers(health=bool(far or external))

    # --- the streams -----------------------------------------------------------------------

    def publisher(self, camera: str, topic: str, *, live: bool = False) -> Publisher:
        """Open a topic of a camera for sending.

        Parameters
        ----------
        camera, topic : str
        live : bool
            Whether the source can't wait for slow receivers: chooses the delivery class.

        Raises
        ------
        NodeFailed
            When the node's kind doesn't declare this output.
        """
        return self._open(Stream(topic, camera), delivery_of(topic, live=live))

    def reference_publisher(self, grid: str) -> Publisher:
        """Open a grid's reference for sending; raises as :meth:`publisher` does."""
        return self._open(Stream(REFERENCE, grid), delivery_of(REFERENCE))

    def _open(self, stream: Stream, delivery: Delivery) -> Publisher:
        if stream not in self._sends:
            kind, external = type(self.config).__name__, self.config.program()
            where = "under 'sends' in the graph" if external else "in outputs()"
            raise NodeFailed(f"{kind} sends {stream} undeclared", f"name it {where}")
        key = topic_key(self.graph.site, stream.of, stream.topic)
        publisher = self._bus.publisher(key, delivery)
        publisher.run_suffix = start_suffix(self.name, self.restarts)
        publisher.goes_on = lambda: self.leaving
        self.outputs.append(publisher)
        return publisher

    def subscribe(self, key_expr: str, delivery: Delivery | None = None) -> str:
        """Subscribe the inbox to a key expression, which is returned.

        Parameters
        ----------
        key_expr : str
        delivery : Delivery, optional
            Delivery class; that of the topic by default.
        """
        delivery = delivery or delivery_of(topic_of(key_expr))
        self._bus.subscribe(self.inbox, key_expr, delivery)
        if delivery.recovers:
            self._recovers.append(key_expr)
        return key_expr

    def show_newest(self, camera: str, text: str) -> None:
        """Show a summary of a camera's newest message in the node's health detail."""
        self._newest[camera] = f"{camera} {text}"
        self.show("; ".join(self._newest.values()))

    def backlog_of(self, name: str) -> Callable[[], bool]:
        """Follow a node's health; return what tells whether something waits in it now."""
        newest: deque[tuple[float, Health]] = deque(maxlen=1)
        words = CallbackInbox(lambda word: newest.append((time.monotonic(), word.message)))
        self._bus.subscribe(words, health_key(self.graph.site, name), LOOKING)

        def waits() -> bool:
            # What holds up its messages holds up its health, until its supervisor tells of it.
            ages = [(time.monotonic() - heard_s, health) for heard_s, health in newest]
            return any(
                age_s < SILENT_S and (health.queue_depth > 0 or age_s > LATE_S)
                for age_s, health in ages
            )

        return waits

    def sender_of(self, topic: str, name: str) -> str:
        """Return the node of this graph that sends a topic of a camera or grid; '' for none."""
        return sender_of(self.graph, topic, name)

    # --- the others ------------------------------------------------------------------------

    def ready(self) -> None:
        """Declare the liveliness token. To be called once all subscriptions are open."""
        self._bus.declare_alive(alive_key(self.graph.site, self.name))
        self.say("running")

    def wait_for_peers(self, *, live: bool = False) -> None:
        """Wait until all other nodes of the graph are ready, so that they miss no message.

        Parameters
        ----------
        live : bool
            A live source doesn't wait for nodes on other hosts: they can request what they missed.
        """
        names = self.peers.names - (elsewhere(self.graph, self.name) if live else set())
        missing = self.peers.wait_for(names, PATIENCE_S, self.stop)
        # A restarted node doesn't wait: some of the others may have ended meanwhile.
        if missing and not self.stop.is_set() and not self.restarts:
            self.say("waiting", f"for {', '.join(sorted(missing))}")
            self.peers.wait_for(names, float("inf"), self.stop)
            self.say("running")

    def _watch_peers(self, *, health: bool) -> None:
        """Subscribe to the states of the others; to all health where some may not be rsenf's."""
        site, key = self.graph.site, health_key if health else word_key
        words = CallbackInbox(
            lambda word: self.peers.on_state(node_of(word.key), word.message.state)
        )
        self._bus.watch_alive(alive_key(site, "*"), self._on_alive)
        self._bus.subscribe(words, key(site, "*"), LOOKING)

    def _on_alive(self, key: str, alive: bool) -> None:
        """Note that a node has come or gone; recover what was missed of one that is back."""
        self.peers.on_alive(key, alive)
        name = node_of(key)
        if alive and name in self.graph.nodes:
            away = name in elsewhere(self.graph, self.name)
            # Nothing was missed of a node of this host that is seen for the first time, and it may
            # end before it can answer.
            if away or self.peers.departures(name)[0]:
                self._recover_tails(name)
            if away:
                # Its token may arrive a moment before its messages do: ask again later.
                again = threading.Timer(SENDS_AGAIN_S, self._recover_tails, (name,))
                again.daemon = True
                again.start()

    def _recover_tails(self, name: str) -> None:
        """Request from a node that is back what this node may have missed."""
        for topic, of in self.graph.nodes[name].outputs():
            key = topic_key(self.graph.site, of, topic)
            kept = delivery_of(topic).recovers
            if kept and any(matches(expr, key) for expr in self._recovers):
                self.inbox.recover_tail(key)

    def reporting(self) -> AbstractContextManager[None]:
        """Publish health regularly."""
        return regularly("health", self._health.beat)

    def beating(self, supervisor: int, writer: int | None = None) -> AbstractContextManager[None]:
        """Send the heartbeat, and watch the parent: see :func:`rsenf.run.heartbeat.beating`."""
        return beating(self._health.progress, self.stop, supervisor, writer)

    def live(self, body: Callable[[NodeProcess], None]) -> int:
        """Run the body, publish how it ended, and return the exit code."""
        try:
            with contextlib.ExitStack() as stack:
                stack.callback(self.flush)
                body(self)
            self._wait_for_readers()
        except RsenfError as exc:
            self.say("failed", str(exc))
            raise
        except Exception as exc:
            self.say("failed", f"{type(exc).__name__}: {exc}")
            raise
        self.say("restarting" if self.leaving else "done", self._health.detail)
        # Of a camera that doesn't wait for its readers, losses are a matter of course.
        lost = [source.partition("/")[2] for source in self._health.lost]
        if any(source_waits(self.graph, camera) for camera in lost):
            self.exit_code = self.exit_code or EXIT_LOSS
        return self.exit_code

    def _wait_for_readers(self) -> None:
        """Stay until readers that are restarted if they die have taken what this node keeps."""
        near = readers_of(self.graph, self.name) - elsewhere(self.graph, self.name)
        # A recorder ends after all others, and a reference is sent again: only until it is back.
        again = self.config.sends_again
        readers = {name: again or bool(self.graph.nodes[name].records) for name in near}
        detail, patience = self._health.detail, Patience(STAYS_S)
        while awaited := sorted(n for n, back in readers.items() if self.peers.needs(n, back)):
            if self.stop.is_set() or patience.over:
                break
            if restarted := [n for n in awaited if self.peers.departures(n)[0]]:
                self.say("waiting", f"for {', '.join(restarted)}, which was restarted")
            self.stop.wait(BEAT_S)
        if self._health.state == "waiting":
            self.say("running", detail)

    def flush(self) -> None:
        """Send the messages that wait to be batched. To be called in the sending thread."""
        for publisher in self.outputs:
            publisher.flush()


def run_node() -> NoReturn:
    """Run the node that the command line names, and end the process."""
    keep_heap()
    args, code = _arguments(), EXIT_FAILED
    try:
        code = _run(args)
    except BaseException:  # noqa: BLE001 - whatever it was, the process ends here
        with contextlib.suppress(Exception):
            complain(traceback.format_exc(), traceback.format_exc(), node=args.node)
    finally:
        end_process(code)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="one node of an rsenf graph")
    parser.add_argument("--graph", type=Path, required=True)
    parser.add_argument("--node", required=True)
    parser.add_argument("--connect", action="append", default=[], help="endpoint of the bus")
    # A restarted source begins a new stream, so it needs a new identity.
    parser.add_argument("--run-id", default=secrets.token_hex(4), help="never the same twice")
    parser.add_argument("--held", type=int, help="descriptor of the graph, if it isn't the file's")
    parser.add_argument("--restarts", type=int, default=0, help="times it was started before")
    parser.add_argument("--gone", action="append", default=[], help="node that has ended already")
    parser.add_argument("--supervisor", type=int, default=0, help="process to end with")
    parser.add_argument("--heartbeat", type=int, help="descriptor to send the heartbeat to")
    return parser.parse_args()


def _run(args: argparse.Namespace) -> int:
    node: NodeProcess | None = None
    try:
        graph = load_graph(args.graph) if args.held is None else held_graph(args.held)
        if args.node not in graph.nodes:
            raise UsageError(f"no node {args.node!r} in {args.graph}")
        with (
            contextlib.ExitStack() as closed,
            open_bus(bus_settings(graph, tuple(args.connect))) as bus,
        ):
            node = NodeProcess(graph, args.node, args.run_id, bus, args.restarts, args.gone)
            node.inbox.whole, node.inbox.restarted = not args.restarts, bool(args.restarts)
            install_signals(node)
            if args.held is not None:
                take_exchanges(node, args.held)
            bus.in_a_hurry = node.stop.is_set
            # Until the bus is closed: a slow reader holds that up, too.
            closed.enter_context(node.beating(args.supervisor, args.heartbeat))
            with node.reporting():
                return node.live(node.config.body)
    except RsenfError as exc:
        # A supervisor has received it over the bus, and reports it.
        if node is None or not args.supervisor:
            complain(f"rsenf: {args.node}: {exc}", str(exc), node=args.node)
        return exc.exit_code


def bus_settings(graph: Graph, router: tuple[str, ...] = ()) -> BusSettings:
    """Return how to connect to the graph's bus.

    Parameters
    ----------
    graph : Graph
    router : tuple of str
        Endpoints of the run's router; without, the graph's ``bus`` section says where.
    """
    bus = graph.bus
    if router:
        return BusSettings(connect=router, zenoh=bus.zenoh)
    return BusSettings(bus.mode, bus.connect, multicast=bus.multicast, zenoh=bus.zenoh)


def install_signals(node: NodeProcess) -> None:
    """Make the first SIGTERM or SIGINT stop a node in order, the second one at once."""
    asked = False

    def stop(_signum: int, _frame: Any) -> None:
        nonlocal asked
        if asked:
            os._exit(EXIT_INTERRUPTED)
        asked = True
        set_by_signal(node.stop)

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
