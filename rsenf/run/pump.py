"""The loop of every node between two topics: receive, feed the stage, send."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from rsenf.bus.bus import Publisher
from rsenf.bus.inbox import Received
from rsenf.bus.keys import source_of
from rsenf.errors import SchemaMismatch
from rsenf.messages import Header
from rsenf.run.node import NodeProcess
from rsenf.run.peers import Peers
from rsenf.run.runner import Branches, Runner

# An input whose sender has gone without an END mark is given up when nothing has come this long.
GIVE_UP_S = 1.0
# One that has ended well has sent its mark: it is under way, behind what a slow reader takes.
UNDER_WAY_S = 60.0
# Told to stop, a node still takes what is under way, but not for longer than this.
LINGER_S = 0.4
POLL_S = 0.1


@dataclass
class Lane:
    """One camera's way through a node.

    Parameters
    ----------
    runner : Runner or Branches
        The stage, or stages, and their life.
    publisher : Publisher
        Where its messages go.
    inputs : dict
        Key of each input that hasn't ended, and the node that sends it.
    ahead : bool
        Whether what comes is ahead of time: nobody waits for each message, so several go at once.
    """

    runner: Runner | Branches
    publisher: Publisher
    inputs: dict[str, str]
    ahead: bool = False
    _heard: dict[str, float] = field(default_factory=dict)
    _begun: set[str] = field(default_factory=set)

    def feed(self, received: Received) -> None:
        """Give the stage a message and send on what it completes."""
        key = received.key
        if key not in self.inputs:
            return
        if received.message.header.is_end:
            del self.inputs[key]
        self.send(self.runner.feed(received.message))
        # What the stage took its time for is no silence of the sender's.
        self._heard[key] = time.monotonic()
        self._begun.add(key)

    def give_up(self, run_id: str, peers: Peers) -> None:
        """End the inputs from which nothing will come any more.

        Parameters
        ----------
        run_id : str
            For the END mark of a stream that never began.
        peers : Peers
            Tells which senders are gone, and how they ended.
        """
        now = time.monotonic()
        for key, sender in list(self.inputs.items()):
            ends = key in self._begun and peers.has_finished(sender)
            patience_s = UNDER_WAY_S if ends else GIVE_UP_S
            silent_s = now - self._heard.setdefault(key, now)
            if min(silent_s, peers.gone_for_s(sender)) > patience_s:
                self._end(key, run_id)

    def end(self, run_id: str) -> None:
        """End what is still open."""
        for key in list(self.inputs):
            self._end(key, run_id)

    def _end(self, key: str, run_id: str) -> None:
        del self.inputs[key]
        self.send(self.runner.end(Header(run_id=run_id, source=source_of(self.publisher.key))))

    def send(self, messages: Iterable[Any]) -> None:
        """Send what the stage has completed."""
        for message in messages:
            self.publisher.send(message, more=self.ahead and not message.header.is_end)


@dataclass(kw_only=True)
class TellingLane(Lane):
    """A lane that tells the newest message in the node's state: all of them have ``in_short``."""

    node: NodeProcess
    camera: str
    latest: dict[str, str]  # of all cameras of the node

    def send(self, messages: Iterable[Any]) -> None:
        """Send messages, and say the newest."""
        for message in messages:
            super().send([message])
            self.tell(message)

    def tell(self, message: Any) -> None:
        """Say the newest message."""
        if not message.header.is_end:
            self.latest[self.camera] = f"{self.camera} {message.in_short}"
            self.node.show("; ".join(self.latest.values()))


def pump(node: NodeProcess, lanes: list[Lane]) -> None:
    """Run until every lane has ended, or the node is told to stop.

    A node told to stop takes what has already arrived, flushes and sends its END marks, so that
    those after it finish too.
    """
    by_key: dict[str, list[Lane]] = {}
    for lane in lanes:
        for key in lane.inputs:
            by_key.setdefault(key, []).append(lane)
    looked, stop_by = 0.0, float("inf")
    while any(lane.inputs for lane in lanes):
        received = node.inbox.receive(POLL_S)
        if received is not None:
            node.note_input(received.message.header)
            for lane in by_key.get(received.key, ()):
                try:
                    lane.feed(received)
                except SchemaMismatch:
                    node.inbox.counters.rejected += 1
        now = time.monotonic()
        if node.stop.is_set():
            stop_by = min(stop_by, now + LINGER_S)
            if received is None or now > stop_by:
                break
        if now - looked > POLL_S and not node.inbox.depth:
            looked = now
            for lane in lanes:
                lane.give_up(node.run_id, node.peers)
    for lane in lanes:
        lane.end(node.run_id)
