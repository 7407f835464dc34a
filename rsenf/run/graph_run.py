"""State of a running graph in its supervisor: the health messages and processes of its nodes."""

from __future__ import annotations

import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import InitVar, dataclass, field
from typing import Any

from rsenf.bus.bus import Bus
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, camera_key, health_key, node_of, source_of, topic_of
from rsenf.bus.ring import PREFIX, ring_directory
from rsenf.config import Graph
from rsenf.config.graph import recorded_by
from rsenf.config.node_kind import Stream
from rsenf.errors import EXIT_USAGE, NodeFailed
from rsenf.messages import Alarm, Health
from rsenf.run.graph_changes import Exchanges
from rsenf.run.health import SUPERVISOR, Announcer
from rsenf.run.peers import GIVEN_UP, LAST_WORDS
from rsenf.run.restart_policy import WENT_WRONG, NodeState, RestartPolicy, Spawn, end_of
from rsenf.timebase import NS_PER_S

# Shutdown: first the sources get SIGTERM and end their streams, after which the other nodes finish
# by themselves. Then the nodes still running get SIGTERM, and in the end SIGKILL. All within two
# seconds; on a machine so slow that the nodes took longer to start, they get as long to stop.
SOURCES_FIRST_S = 0.7
KILL_AFTER_S = 1.7
MOST_S = 20.0  # a start may take hours for want of a camera, not of speed
POLL_S = 0.05
UNDER_WAY_S = 0.5  # longest wait for the last words of a node that has ended
MOST_ALARMS = 100  # kept for each camera, reported at the end
# Topics whose latest messages a run reports at its end.
RESULTS = ("match", "idle", "live", "alarm", "discover")


@dataclass
class GraphRun:
    """A running graph.

    Parameters
    ----------
    graph : Graph
        The graph.
    run_id : str
        Identity of this run.
    endpoint : str
        Address of the bus, for others to connect to.
    nodes : dict
        State of each node by name.
    on_change : callable
        Called with a node at every change of its state.
    spawn : callable
        Starts a node's process.
    bus : Bus
        Open bus, for the health of the nodes and the topics that a run reports at its end.
    host : str, optional
        Host of this run, in a graph that is split over hosts.

    Attributes
    ----------
    latest : dict
        By topic (:data:`RESULTS`), the latest message of each camera.
    alarms : dict
        Alarms of each camera, their ends included, in order; the latest of them.
    alarm_counts : Counter
        Alarms that began, by camera and kind.
    stops : bool
        Whether a recorder was lost, and the graph's rule is to stop then.
    never_began : bool
        Whether a node failed before all were ready. The run then stops: nodes that have never seen
        its token would wait for it for ever.
    on_result : callable
        Called with each camera and message of :data:`RESULTS`.
    exchanges : Exchanges
        Exchanges the graph for another.
    """

    graph: Graph
    run_id: str
    endpoint: str
    nodes: dict[str, NodeState]
    on_change: Callable[[NodeState], None]
    spawn: InitVar[Spawn]
    bus: Bus
    host: str = ""
    latest: dict[str, dict[str, Any]] = field(default_factory=lambda: {t: {} for t in RESULTS})
    alarms: dict[str, deque[Alarm]] = field(default_factory=dict)
    alarm_counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    stops: bool = False
    never_began: bool = False
    on_result: Callable[[str, Any], None] = lambda source, message: None
    _words: Inbox = field(default_factory=Inbox)
    _begun: float = field(default_factory=time.monotonic)
    _look_s: float = 0.0  # when the processes are to be looked at again
    _all_ready_s: float = 0.0  # since the start
    _stopping: bool = False
    _subscribed: set[Stream] = field(default_factory=set)
    _results: set[Stream] = field(default_factory=set)  # of the present cameras

    def __post_init__(self, spawn: Spawn) -> None:
        self._revival = RestartPolicy(self.graph, self.nodes, spawn)
        self.exchanges = Exchanges(self.graph, self.host)
        self._announcer = Announcer(self.bus, self.graph.site, self.run_id)
        self.bus.subscribe(self._words, health_key(self.graph.site, "*"), LOOKING)
        self._subscribe()

    def start(self) -> None:
        """Start every node."""
        for node in self.nodes.values():
            self._revival.start(node)
            self._note_own(node)

    def _note_own(self, node: NodeState) -> None:
        """Count an external program as running while its process lives: it may send no health."""
        if self.graph.nodes[node.name].program():
            node.was_ready = True
            self._change(node, "running", "")

    @property
    def running(self) -> list[NodeState]:
        """Nodes whose processes live."""
        nodes = (*self.nodes.values(), *self.exchanges.removed)
        return [n for n in nodes if n.process and n.exit_code is None]

    def wait(
        self, stop: threading.Event, exchanged: Callable[[], Graph | None] = lambda: None
    ) -> None:
        """Watch until every process has ended; stop them when asked to, or when one can't start.

        They are stopped, too, when a recorder is lost, if the graph says so. A host without nodes
        is a router only, and runs until it is stopped.

        Parameters
        ----------
        stop : Event
        exchanged : callable, optional
            Returns another graph to go on with, when there is one.
        """
        while not (stop.is_set() or self.never_began or self.stops):
            if self.nodes and not (self.running or self._revival.due):
                break
            self.watch(POLL_S)
            if self.exchanges.complete and (graph := exchanged()):
                self.graph = graph
                self.exchanges.begin(graph, self.nodes, self._revival)
                self._subscribe()
        self.stop()
        self._listen_until_quiet()

    def watch(self, timeout_s: float) -> None:
        """Take a message of the nodes, notice ended processes, and apply the restart policy.

        However many messages come, the processes are looked at every ``POLL_S``, and not more
        often.
        """
        if self._listen(timeout_s) and time.monotonic() < self._look_s:
            return
        self._look_s = time.monotonic() + POLL_S
        for _ in range(self._words.depth):
            self._listen(0.0)
        for node in self.running:
            assert node.process is not None
            code = node.process.poll()
            if code is not None:
                self._listen_until_quiet()
                node.ended(code)
                self._ended(node, *end_of(node, code))
        if self._stopping:
            return
        for node in self._revival.start_due():
            often = f"for the {node.restarts + 1}. time" if node.restarts else ""
            self._change(node, "starting", often)
            self._note_own(node)
        self.exchanges.kill_late()
        for node, state, why in self._revival.watch():
            self._change(node, state, why)
        for node in self._revival.note_behind():
            self.on_change(node)
        for node, since_s, by in self._revival.held_up():
            self._announcer.tell_held_up(node, since_s, by)

    def _ended(self, node: NodeState, state: str, detail: str) -> None:
        """Handle the end of a process; schedule a restart where the node's rule says so."""
        assert node.process is not None
        assert node.exit_code is not None
        if self.exchanges.ended(node):
            self.on_change(node)
            return
        again = ""
        if self.exchanges.continues(node) and not self._stopping:
            detail, again = "it stopped", "started again with other settings"
            self._revival.begin(node)
        elif state in WENT_WRONG and not self._stopping:
            again = self._revival.plan(node, node.exit_code)
        if again:
            self._remove_rings(f"{self.run_id}-*-{node.process.pid}")
            self._change(node, "restarting", f"{detail}; {again}")
        else:
            self._change(node, state, detail)
            goes_on = not (self._stopping or self.never_began)
            if self.graph.nodes[node.name].records and node.went_wrong and goes_on:
                self.stops |= self.graph.on_record_loss == "stop"
                cameras = recorded_by(self.graph, node.name)
                pts_ns = round((time.monotonic() - self._begun) * NS_PER_S)
                self._announcer.raise_unrecorded(node, cameras, pts_ns)
        self._tell_others(node)

    def _tell_others(self, node: NodeState) -> None:
        """Publish health for a node that can't any more, so that its readers wait for it or not."""
        said = {"restarting": "restarting", "done": "done"}.get(node.state, GIVEN_UP)
        is_own = bool(self.graph.nodes[node.name].program())
        rule = self.graph.restart_of(node.name)
        others_know = rule is None and not is_own and node.state != "restarting"
        if not others_know:
            self._announcer.tell(node, said)

    def stop(self) -> None:
        """Stop everything within two seconds: sources first, so that streams end with END marks."""
        self._stopping = True
        for node in self._revival.forget():
            self._change(node, "lost", node.detail.partition(";")[0])
        begun = time.monotonic()
        patience_s = min(max(KILL_AFTER_S, self._start_took_s), MOST_S)
        if not self.never_began:
            configs = self.graph.nodes  # without the nodes that a reload has removed
            self._tell(n for n in self.running if n.name in configs and configs[n.name].is_source)
            self._wait_until(begun + patience_s * SOURCES_FIRST_S / KILL_AFTER_S)
        self._tell(self.running)
        self._wait_until(begun + patience_s)
        self.kill()
        self._wait_until(begun + patience_s + 1.0)

    def kill(self) -> None:
        """Kill every process at once, and remove their shared-memory rings."""
        for node in self.running:
            node.signal(signal.SIGKILL)
        self._remove_rings(self.run_id)

    def _remove_rings(self, of: str) -> None:
        for ring in ring_directory().glob(f"{PREFIX}{of}-*"):
            ring.unlink(missing_ok=True)

    @property
    def _start_took_s(self) -> float:
        """Seconds until all nodes were ready; until now, if not all are."""
        return self._all_ready_s if self._all_ready else time.monotonic() - self._begun

    @property
    def _all_ready(self) -> bool:
        return self.exchanges.count > 0 or all(n.was_ready for n in self.nodes.values())

    def _tell(self, nodes: Iterable[NodeState]) -> None:
        """Send SIGTERM, once only: a second one makes a node end at once."""
        for node in nodes:
            if not node.asked_to_end and node.state not in LAST_WORDS:
                node.asked_to_end = True
                node.signal(signal.SIGTERM)

    def _wait_until(self, deadline: float) -> None:
        while self.running and time.monotonic() < deadline:
            self.watch(POLL_S)

    def _listen_until_quiet(self) -> None:
        """Take what is still under way. On a busy bus it is never quiet: not for long."""
        until = time.monotonic() + UNDER_WAY_S
        while self._listen(POLL_S) and time.monotonic() < until:
            pass

    def _listen(self, timeout_s: float) -> bool:
        received = self._words.receive(timeout_s)
        if received is None:
            return False
        if isinstance(received.message, Health):
            node = self.nodes.get(node_of(received.key))
            if node is not None and self._is_of(received.message, node):
                self._revival.heard(node, received.message)
                node.health = received.message
                if received.message.state == "running" and not node.was_ready:
                    node.was_ready = True
                    self._all_ready_s = time.monotonic() - self._begun
                if node.state != "stalled" or not self._revival.hangs(node):
                    self._change(node, received.message.state, received.message.detail)
        elif not received.message.header.is_end:
            source, topic = source_of(received.key), topic_of(received.key)
            if Stream(topic, source.partition("/")[2]) not in self._results:
                return True  # of a camera that a reload has removed
            self.latest[topic][source] = received.message
            if topic == "alarm":
                alarms = self.alarms.setdefault(source, deque(maxlen=MOST_ALARMS))
                alarms.append(received.message)
                self.alarm_counts[source, received.message.kind] += received.message.active
            self.on_result(source, received.message)
        return True

    def _is_of(self, health: Health, node: NodeState) -> bool:
        """Whether health is of the node's present process, not an earlier one or another run's."""
        of_run, _, said_by = health.header.run_id.partition(".")
        if node.exit_code is not None or of_run != self.run_id or said_by == SUPERVISOR:
            return False
        return node.process is None or health.pid == node.process.pid

    def _change(self, node: NodeState, state: str, detail: str) -> None:
        before = node.state, node.detail
        node.state, node.detail = state, detail
        # A node with a restart rule may come back, until its process has ended for good.
        final = node.exit_code is not None or self.graph.restart_of(node.name) is None
        if node.went_wrong and final and not self._all_ready:
            self.never_began = True
        if before != (state, detail):
            self.on_change(node)

    def _subscribe(self) -> None:
        """Subscribe to the results of the present cameras, and forget those of others."""
        site = self.graph.site
        streams = {stream for n in self.nodes for stream in self.graph.nodes[n].outputs()}
        streams |= {
            Stream("alarm", camera) for n in self.nodes for camera in recorded_by(self.graph, n)
        }
        self._results = {stream for stream in streams if stream.topic in RESULTS}
        for topic, camera in self._results - self._subscribed:
            self.bus.subscribe(self._words, camera_key(site, camera, topic), LOOKING)
        self._subscribed |= self._results
        for topic, camera in self._subscribed - self._results:
            source = f"{site}/{camera}"
            self.latest[topic].pop(source, None)
            if topic == "alarm":
                self.alarms.pop(source, None)
                for counted in [key for key in self.alarm_counts if key[0] == source]:
                    del self.alarm_counts[counted]


def check_ended(run: GraphRun) -> int:
    """Return the exit code of a graph that has ended: the highest of its nodes'.

    Raises
    ------
    NodeFailed
        When a node was lost or failed; with the usage exit code when all of these ended with it.
    """
    bad = [n for n in run.nodes.values() if n.went_wrong]
    if bad:
        failure = NodeFailed("; ".join(f"{n.name}: {n.detail}" for n in bad))
        if all(n.exit_code == EXIT_USAGE for n in bad):
            failure.exit_code = EXIT_USAGE
        raise failure
    # Below 0: killed by SIGTERM before its signal handler was installed.
    return max([0, *(n.exit_code or 0 for n in run.nodes.values())])
