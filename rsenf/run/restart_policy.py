"""State of a node in its supervisor; restart policy and watchdog.

Nodes that died are restarted, with exponential backoff and a limit on the number within a sliding
time window. Nodes that hang are killed.

A node hangs when it sends neither heartbeat nor health (*silent*), or when it makes no progress
though messages wait, or no health comes (*stalled*). A reader in which messages wait holds up its
senders by backpressure, so that they seem to stall, and those without a heartbeat, as programs in
other languages are, seem to be silent: they are not to blame.
"""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from rsenf.bus.keys import SILENT_S
from rsenf.config import Graph
from rsenf.config.graph import readers_of, source_waits
from rsenf.config.node_kind import Restart
from rsenf.errors import EXIT_LOSS, EXIT_USAGE
from rsenf.messages import Health
from rsenf.run.fork_server import Process
from rsenf.run.heartbeat import Heartbeat, Progress, Pulse
from rsenf.run.peers import LAST_WORDS

WENT_WRONG = ("lost", "failed")
HANGS = ("silent", "stalled")


@dataclass
class NodeState:
    """State of a node.

    Attributes
    ----------
    state : str
        As its health says: 'starting', 'waiting', 'running', 'done' or 'failed'; 'lost' when its
        process ended without saying so; 'restarting' when a restart is due; 'silent' without a
        sign of life, 'stalled' without progress though messages wait.
    heartbeat : Heartbeat or None
        That of its process, while it runs.
    pulse : Pulse
        When it was last heard of; begun anew with each process.
    behind : str
        How far it is behind a camera, in words; empty if it isn't.
    starts : int
        How often it was started, before a reload removed it included.
    deaths_s : deque of float
        Times of the deaths within the time window of its restart rule.
    due_s : float or None
        When it is to be started again; None if it isn't.
    """

    name: str
    kind: str
    state: str = "starting"
    detail: str = ""
    health: Health | None = None
    process: Process | None = None
    heartbeat: Heartbeat | None = None
    pulse: Pulse = field(default_factory=Pulse)
    exit_code: int | None = None
    asked_to_end: bool = False  # SIGTERM was sent
    was_ready: bool = False
    behind: str = ""
    starts: int = 0
    deaths_s: deque[float] = field(default_factory=deque)
    due_s: float | None = None

    @property
    def restarts(self) -> int:
        """Number of restarts."""
        return max(self.starts - 1, 0)

    @property
    def beats(self) -> bool:
        """Whether its process sends a heartbeat, as all do but external programs by other means."""
        return self.heartbeat is not None and self.heartbeat.is_sent

    @property
    def went_wrong(self) -> bool:
        """Whether it failed or was lost."""
        return self.state in WENT_WRONG

    def ended(self, exit_code: int) -> None:
        """Note that its process has ended."""
        self.exit_code = exit_code
        if self.heartbeat:
            self.heartbeat.close()
            self.heartbeat = None

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to its process, unless it has ended."""
        if self.process and self.exit_code is None:
            self.process.send_signal(number)


def end_of(node: NodeState, code: int) -> tuple[str, str]:
    """Return the state and detail of a node whose process has ended.

    Parameters
    ----------
    node : NodeState
        As it was before.
    code : int
        Exit code; below 0 the negative number of the signal that killed it.
    """
    if node.state == "failed" or (node.state == "done" and code >= 0):
        return node.state, node.detail
    by_us = node.asked_to_end and code in (-signal.SIGTERM, -signal.SIGKILL)
    # SIGTERM: before its signal handler was installed; SIGKILL: still starting, so nothing is lost.
    if by_us and (code == -signal.SIGTERM or node.state == "starting"):
        return "done", "stopped before it began"
    if by_us:
        return "failed", "did not stop in time and was killed"
    if code < 0:
        return "lost", f"killed by signal {-code}"
    if code == EXIT_LOSS and node.kind != "external":
        return "done", "something was lost on the way; what, didn't get through"
    return ("failed", f"exit code {code}") if code else ("done", node.detail)


def pause_s(
    rule: Restart | None, deaths_s: deque[float], now_s: float, exit_code: int
) -> float | None:
    """Note a death; return the pause (s) before the restart, or None for no restart.

    Parameters
    ----------
    rule : Restart or None
        Without a rule, a node is never restarted.
    deaths_s : deque of float
        Times of its deaths so far.
    now_s : float
        Time of this one by the same clock.
    exit_code : int
        After a usage error there is no restart: it would only repeat the error.
    """
    if rule is None or exit_code == EXIT_USAGE:
        return None
    while deaths_s and now_s - deaths_s[0] > rule.within_s:
        deaths_s.popleft()
    if len(deaths_s) >= rule.limit:
        return None
    pause_s = rule.backoff_s * 2.0 ** min(len(deaths_s), 30)
    deaths_s.append(now_s)
    return float(min(pause_s, rule.backoff_max_s))


# A longer gap between two checks means that the supervisor itself was held up; it is not counted
# as silence of the nodes.
HELD_UP_S = 1.0
# A reader in which messages have waited for so long may hold up its senders.
HOLDS_UP_S = 10.0
# A node is behind a camera if messages wait in it, and it is late, for so long.
BEHIND_S = 5.0
# A node's overdue health is told of before observers take the node for silent.
OVERDUE_S = SILENT_S - 1.0
Spawn = Callable[[NodeState], Process]


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
        self._nodes, self._spawn, self._clock = nodes, spawn, clock
        self._looked_s = clock()
        self.take(graph)

    def take(self, graph: Graph) -> None:
        """Apply the rules of a graph to the nodes that there are now."""
        self._graph = graph
        # A recorder takes everybody's health, its own included. Two don't excuse each other.
        recorders = {name for name, config in graph.nodes.items() if config.records}
        self._readers = {
            name: readers_of(graph, name) | ({name} if name in recorders else recorders)
            for name in self._nodes
        }

    def begin(self, node: NodeState) -> None:
        """Start a node at the next :meth:`start_due`."""
        node.due_s = self._clock()

    @property
    def due(self) -> list[NodeState]:
        """Nodes that wait to be started."""
        return [node for node in self._nodes.values() if node.due_s is not None]

    def start(self, node: NodeState) -> None:
        """Start a node's process."""
        node.starts += 1
        node.process, node.exit_code, node.asked_to_end = self._spawn(node), None, False
        node.pulse, node.health = Pulse(self._clock()), None

    def heard(self, node: NodeState, health: Health) -> None:
        """Note a health message of a node."""
        node.pulse.health_s = self._clock()
        if not node.beats:
            counts = health.messages_in, health.messages_out, health.queue_depth
            node.pulse.note(Progress(*counts), self._clock())

    def plan(self, node: NodeState, exit_code: int) -> str:
        """Schedule the restart of a node that died.

        Returns
        -------
        str
            When it is restarted, in words; empty for no restart.
        """
        rule, now_s = self._graph.restart_of(node.name), self._clock()
        wait_s = pause_s(rule, node.deaths_s, now_s, exit_code)
        if rule is None or wait_s is None:
            return ""
        node.due_s = now_s + wait_s
        number = f"{len(node.deaths_s)} of {rule.limit} within {rule.within_s:g} s"
        return f"started again in {wait_s:g} s, {number}"

    def start_due(self) -> list[NodeState]:
        """Start the nodes whose pause is over; return them.

        Where a restarted node reads a grid's reference whose sender is done, the sender is started
        once more as well: the reference was lost with the process that died.
        """
        now_s = self._clock()
        started = [node for node in self.due if node.due_s is not None and node.due_s <= now_s]
        for node in started:
            node.due_s = None
        read = {i.stream for node in started for i in self._graph.nodes[node.name].inputs()}
        for name, config in self._graph.nodes.items():
            if config.sends_again and not read.isdisjoint(config.outputs()):
                sender = self._nodes.get(name)  # None: on another host
                ended = sender and sender.state == "done" and sender.exit_code is not None
                if sender and ended and sender not in started:
                    started.append(sender)
        for node in started:
            self.start(node)
        return started

    def forget(self) -> list[NodeState]:
        """Cancel all restarts; return the nodes that waited for one."""
        waiting = self.due
        for node in waiting:
            node.due_s = None
        return waiting

    def watch(self) -> list[tuple[NodeState, str, str]]:
        """Return the nodes that hang, with 'silent' or 'stalled' and a sentence about it.

        Of those with a restart rule the first is killed, and all time limits start anew. To be
        called when all health that has come was noted.
        """
        now_s = self._clock()
        held_up_s, self._looked_s = now_s - self._looked_s, now_s
        if held_up_s > HELD_UP_S:
            for node in self._nodes.values():
                node.pulse.shift(held_up_s)
        for node in self._nodes.values():
            if node.heartbeat and (progress := node.heartbeat.newest()):
                node.pulse.note(progress, now_s)
        found = [(node, *hangs) for node in self._nodes.values() if (hangs := self.hangs(node))]
        ruled = [node for node, *_ in found if self._graph.restart_of(node.name)]
        if ruled:
            first = min(ruled, key=lambda node: node.pulse.moved_s)
            first.signal(signal.SIGKILL)
            for node in self._nodes.values():
                node.pulse.begin_anew(float("inf") if node is first else now_s)
        return found

    def hangs(self, node: NodeState) -> tuple[str, str] | None:
        """Return 'silent' or 'stalled' and a sentence about a node that hangs, or else None.

        Without a restart rule its default limits count.
        """
        if node.process is None or node.exit_code is not None or node.state in LAST_WORDS:
            return None
        if self._graph.nodes[node.name].program() and node.health is None:
            return None  # an external program that has never sent health
        pulse, now_s = node.pulse, self._clock()
        rule = self._graph.restart_of(node.name) or Restart()
        behind = set(self._behind(node))
        if pulse.is_silent(rule, now_s) and (node.beats or not behind):
            return "silent", f"no sign of life for {rule.silent_s:g} s"
        if pulse.is_stalled(rule) and not behind - {node.name}:
            return "stalled", f"messages wait, none taken or sent for {rule.stalled_s:g} s"
        if pulse.is_mute(rule) and not behind:
            return "stalled", f"it lives, but no word of its health for {rule.stalled_s:g} s"
        return None

    def held_up(self) -> list[tuple[NodeState, float, list[str]]]:
        """Return nodes that live but whose health is overdue.

        Each with the time since its last health, and the readers that may hold it up.
        """
        now_s = self._clock()
        ages_s = [(n, now_s - n.pulse.health_s) for n in self._nodes.values() if n.beats]
        return [
            (node, age_s, self._behind(node, OVERDUE_S))
            for node, age_s in ages_s
            if age_s > OVERDUE_S > now_s - node.pulse.heard_s
        ]

    def note_behind(self) -> list[NodeState]:
        """Note which nodes are behind a camera; return those of which there is something to tell.

        That is the beginning, twice as long a delay or as many dropped messages, and the end.
        """
        now_s, now_ns, changed = self._clock(), time.time_ns(), []
        for node in self._nodes.values():
            pulse, health = node.pulse, node.health
            if health is None:
                continue
            waits = node.exit_code is None and pulse.is_behind(now_s, BEHIND_S)
            last_ns = health.last_input_ns
            since_s = (now_ns - last_ns) / 1e9 if last_ns else now_s - pulse.idle_s
            # None has waited for longer; arrival times may be of another clock.
            late_s = min(max(health.latency_s, since_s), now_s - pulse.idle_s) if waits else 0.0
            dropped = health.dropped > 2 * pulse.reported_dropped
            more = dropped or late_s > max(2 * pulse.reported_s, BEHIND_S)
            if not more and (waits or not node.behind):
                continue
            if all(source_waits(self._graph, of) for of in self._graph.nodes[node.name].feeds):
                continue  # asked last, since it asks every node
            changed.append(node)
            pulse.reported_s, node.behind = late_s, ""
            if more:
                pulse.reported_dropped = health.dropped
                by = ", ".join(self._behind(node, BEHIND_S))
                parts = [f"behind by {late_s:.0f} s" if late_s >= 1.0 else "behind"]
                parts += [f"held up by {by}"] if by else []
                parts += [f"{health.dropped} frames dropped"] if health.dropped else []
                node.behind = ", ".join(parts)
        return changed

    def _behind(self, node: NodeState, for_s: float = HOLDS_UP_S) -> list[str]:
        """Return the readers that may hold a node up; of other hosts' readers nothing is known."""
        now_s = self._clock()
        readers = [self._nodes[name] for name in self._readers[node.name] if name in self._nodes]
        lives = [reader for reader in readers if reader.exit_code is None]
        return sorted(reader.name for reader in lives if reader.pulse.is_behind(now_s, for_s))
