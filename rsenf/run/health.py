"""Health reporting of a node: published every second, at every change of state, and at its end.

Includes the latency of the node's inputs: median and 95th percentile of the last minute. A
supervisor publishes for nodes that can't: their states, and alarms of lost recorders.
"""

from __future__ import annotations

import math
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import psutil

from rsenf.bus.bus import Bus, Publisher
from rsenf.bus.keys import (
    HEALTH,
    camera_key,
    health_key,
    source_of,
    start_suffix,
    topic_of,
    word_key,
)
from rsenf.config import redact
from rsenf.messages import Alarm, Header, Health
from rsenf.run.heartbeat import Progress

if TYPE_CHECKING:
    from rsenf.run.node import NodeProcess
    from rsenf.run.restart_policy import NodeState

MINUTE_S = 60.0
MOST = 2048  # latencies held: more than a minute of frames at 30 Hz


class LastMinute:
    """Latencies of the last minute. Thread-safe."""

    def __init__(self) -> None:
        self._taken: deque[tuple[float, float]] = deque(maxlen=MOST)
        self._lock = threading.Lock()

    def note(self, now_s: float, latency_s: float) -> None:
        """Add a latency, with the time by any monotonic clock, both in seconds."""
        with self._lock:
            self._taken.append((now_s, latency_s))

    def p50_p95_s(self, now_s: float) -> tuple[float, float]:
        """Return median and 95th percentile; NaN without any latency."""
        with self._lock:
            while self._taken and now_s - self._taken[0][0] > MINUTE_S:
                self._taken.popleft()
            values = sorted(latency for _, latency in self._taken)
        if not values:
            return math.nan, math.nan
        return values[(len(values) - 1) // 2], values[math.ceil(0.95 * len(values)) - 1]


EVERY_S = 1.0
# Rate limit: with a file at full speed the detail may change a hundred times a second, and every
# node of the graph receives it.
DETAIL_EVERY_S = 0.5


class HealthReport:
    """Collects and publishes a node's health. Thread-safe.

    Parameters
    ----------
    node : NodeProcess
        Tells what its inbox has counted, what it has sent, and which other nodes are lost.
    bus : Bus
        Where it is published: every message of it, and those at a change of state once more.
    """

    def __init__(self, node: NodeProcess, bus: Bus) -> None:
        self.state, self.detail = "starting", ""
        self._outside: Callable[[], int] = lambda: 0
        self._node, self._run_id = node, node.run_id + start_suffix(node.name, node.restarts)
        self._publisher = bus.publisher(health_key(node.graph.site, node.name), HEALTH)
        self._words = bus.publisher(word_key(node.graph.site, node.name), HEALTH)
        self._taken, self._rate = 0, _Rate()
        self._last_input_ns, self._latency_s = 0, 0.0
        self._since_arrival, self._since_exposure = LastMinute(), LastMinute()
        self._said = ""  # the state last sent to ``words``
        self._lock = threading.Lock()
        self._published_s, self._published_lost = 0.0, tuple[str, ...]()
        self._cut_off: dict[str, str] = {}

    def note_input(self, header: Header) -> None:
        """Count an input message, and its latency since exposure and since arrival."""
        self._taken += 1
        self._last_input_ns, now_s = time.time_ns(), time.monotonic()
        if header.arrival_time_ns:
            self._latency_s = (self._last_input_ns - header.arrival_time_ns) / 1e9
            self._since_arrival.note(now_s, self._latency_s)
        if header.camera_time_ns:
            exposed_s = (self._last_input_ns - header.camera_time_ns) / 1e9
            self._since_exposure.note(now_s, exposed_s)

    def count_waiting(self, outside: Callable[[], int]) -> None:
        """Count what waits outside the bus, such as a camera's packets, among what waits here."""
        self._outside = outside

    def note_cut_off(self, key: str) -> None:
        """Note that a stream ended while this node was restarted: how much it lost isn't known."""
        self._cut_off[source_of(key)] = f"the end of its {topic_of(key)} came during a restart"

    @property
    def lost(self) -> dict[str, str]:
        """What was lost as a node was restarted, in words, by source."""
        said = dict[str, str](self._cut_off)
        for key, frames in self._node.inbox.counters.uncovered.copy().items():
            if frames:
                text = f"{frames} frames have no {topic_of(key)}, as a node was restarted"
                said[source_of(key)] = "; ".join(filter(None, (said.get(source_of(key)), text)))
        return said

    def say(self, state: str, detail: str = "") -> None:
        """Change the state, and publish it at once."""
        with self._lock:
            self.state, self.detail = state, redact(detail)
            self._publish()

    def show(self, detail: str) -> None:
        """Change the detail of a running node; published at most every 0.5 s."""
        with self._lock:
            self.state, self.detail = "running", redact(detail)
            if time.monotonic() - self._published_s >= DETAIL_EVERY_S:
                self._publish()

    def beat(self) -> None:
        """Publish when a second has passed or another node was lost. To be called often."""
        with self._lock:
            late = time.monotonic() - self._published_s >= EVERY_S
            if late or self._node.peers.lost != self._published_lost:
                self._publish()

    def progress(self) -> Progress:
        """Return the messages taken, sent and waiting."""
        return Progress(self._taken, self._sent, self._depth)

    @property
    def _sent(self) -> int:
        return sum(output.sent for output in self._node.outputs)

    @property
    def _depth(self) -> int:
        pending = sum(output.pending for output in self._node.outputs)
        return self._outside() + self._node.inbox.depth + pending

    def _publish(self) -> None:
        """Number and send; under the lock, so that messages keep their order."""
        counters, usage = self._node.inbox.counters, os.times()
        self._published_s, self._published_lost = time.monotonic(), self._node.peers.lost
        now_ns = time.time_ns()
        arrival = self._since_arrival.p50_p95_s(self._published_s)
        exposure = self._since_exposure.p50_p95_s(self._published_s)
        health = Health(
            header=Header(
                run_id=self._run_id,
                source=self._node.name,
                seq=self._publisher.sent,
                arrival_time_ns=now_ns,
            ),
            node=self._node.name,
            kind=self._node.config.kind,
            state=self.state,
            detail="; ".join(filter(None, (self.detail, *map(": ".join, self.lost.items())))),
            pid=os.getpid(),
            host=socket.gethostname(),
            time_ns=now_ns,
            messages_in=self._taken,
            messages_out=self._sent,
            dropped=counters.dropped,
            missed=counters.missed,
            rejected=counters.rejected,
            recovered=counters.recovered,
            rate_hz=self._rate.per_s(self._taken),
            queue_depth=self._depth,
            latency_s=self._latency_s,
            last_input_ns=self._last_input_ns,
            lost_peers=self._published_lost,
            memory_bytes=psutil.Process().memory_info().rss,
            cpu_s=usage.user + usage.system,
            restarts=self._node.restarts,
            latency_p50_s=arrival[0],
            latency_p95_s=arrival[1],
            exposure_p50_s=exposure[0],
            exposure_p95_s=exposure[1],
        )
        self._publisher.send(health)
        if self.state != self._said:
            self._said = self.state
            word = replace(health, header=health.header.numbered(self._words.sent))
            self._words.send(word)


class _Rate:
    """Messages a second, smoothed over a few seconds."""

    def __init__(self) -> None:
        self._count, self._since, self._value = 0, time.monotonic(), 0.0

    def per_s(self, count: int) -> float:
        """Return the rate, given the count so far."""
        now = time.monotonic()
        if now - self._since >= EVERY_S:
            fresh = (count - self._count) / (now - self._since)
            self._value = 0.5 * (self._value + fresh) if self._value else fresh
            self._count, self._since = count, now
        return self._value


# A node that hangs must not block its supervisor.
TELLING = replace(HEALTH, lossless=False)
AGAIN_S = 1.0


SUPERVISOR = "supervisor"  # what names its messages, after the run


class Announcer:
    """Publishes for nodes.

    Parameters
    ----------
    bus : Bus
    site, run_id : str
        Of the run.
    """

    def __init__(self, bus: Bus, site: str, run_id: str) -> None:
        self._bus, self._site, self._run_id = bus, site, run_id
        self._publishers: dict[str, Publisher] = {}
        self._told_s: dict[str, float] = {}

    def tell(self, node: NodeState, state: str) -> None:
        """Publish the state of a node whose process has ended, to the other nodes, too."""
        health = replace(node.health or Health(), detail=node.detail)
        for key in (health_key, word_key):
            self._publish(key(self._site, node.name), self._of(node, health, state))

    def tell_held_up(self, node: NodeState, since_s: float, by: Iterable[str]) -> None:
        """Publish that a node lives whose health some reader holds up; once a second.

        Parameters
        ----------
        node : NodeState
        since_s : float
            Time since its last health.
        by : iterable of str
            Names of readers that may hold it up.
        """
        now_s = time.monotonic()
        if node.health is None or now_s - self._told_s.get(node.name, -AGAIN_S) < AGAIN_S:
            return
        self._told_s[node.name] = now_s
        named = ", ".join(by)
        text = f"its health is held up{' by ' if named else ''}{named} ({since_s:.0f} s)"
        detail = "; ".join(filter(None, (text, node.health.detail)))
        # It waits itself, if nothing else does.
        depth = max(node.health.queue_depth, 1)
        said = replace(node.health, detail=detail, queue_depth=depth)
        self._publish(health_key(self._site, node.name), self._of(node, said, said.state))

    def raise_unrecorded(self, node: NodeState, cameras: Iterable[str], pts_ns: int) -> None:
        """Raise an alarm at each camera that a lost recorder recorded.

        Parameters
        ----------
        node : NodeState
            The recorder.
        cameras : iterable of str
        pts_ns : int
            Time of the loss by the run's clock.
        """
        for camera in cameras:
            header = Header(
                run_id=f"{self._run_id}.{node.name}",
                source=f"{self._site}/{camera}",
                pts_ns=pts_ns,
                arrival_time_ns=time.time_ns(),
            )
            alarm = Alarm(
                header=header, kind="unrecorded", severity="alarm",
                start_pts_ns=pts_ns, end_pts_ns=pts_ns, text=f"{node.name}: {node.detail}",
            )  # fmt: skip
            self._publish(camera_key(self._site, camera, "alarm"), alarm)

    def _of(self, node: NodeState, health: Health, state: str) -> Health:
        """Return health of a node as told by this process."""
        # A stream of its own, as a recording holds each number of a stream once.
        now_ns, run_id = time.time_ns(), f"{self._run_id}.{SUPERVISOR}"
        header = Header(run_id=run_id, source=node.name, arrival_time_ns=now_ns)
        return replace(
            health, header=header, node=node.name, kind=node.kind, state=state,
            restarts=node.restarts, pid=os.getpid(), host=socket.gethostname(), time_ns=now_ns,
        )  # fmt: skip

    def _publish(self, key: str, message: Any) -> None:
        """Number and send a message."""
        if key not in self._publishers:
            self._publishers[key] = self._bus.publisher(key, TELLING)
        publisher = self._publishers[key]
        header = message.header.numbered(publisher.sent)
        publisher.send(replace(message, header=header))
