"""The loop of every node between two topics: receive, feed the stage, send."""

from __future__ import annotations

import time
from dataclasses import dataclass

from rsenf.bus.inbox import Received
from rsenf.bus.zenoh_bus import Publisher
from rsenf.messages import Header
from rsenf.run.node import NodeProcess
from rsenf.run.runner import Runner

# An input whose sender has gone without an END mark is given up when nothing has come this long.
GIVE_UP_S = 1.0
# Told to stop, a node still takes what is under way, but not for longer than this.
LINGER_S = 0.7


@dataclass
class Lane:
    """One camera's way through a node.

    Parameters
    ----------
    runner : Runner
        The stage and its life.
    publisher : Publisher
        Where its messages go.
    inputs : dict
        Key of each input, and the node that sends it.
    """

    runner: Runner
    publisher: Publisher
    inputs: dict[str, str]

    def feed(self, received: Received) -> None:
        """Give the stage a message and send on what it completes."""
        if received.message.header.is_end:
            self.inputs.pop(received.key, None)
        for message in self.runner.feed(received.message):
            self.publisher.send(message)

    def give_up(self, node: NodeProcess) -> None:
        """End the inputs whose senders are gone."""
        for key, sender in list(self.inputs.items()):
            if node.peers.gone_for_s(sender) > GIVE_UP_S:
                del self.inputs[key]
                source = key.removeprefix("rsenf/").rsplit("/", 1)[0]
                for message in self.runner.end(Header(run_id=node.run_id, source=source)):
                    self.publisher.send(message)


def pump(node: NodeProcess, lanes: list[Lane]) -> None:
    """Run until every lane has ended, or the node is told to stop.

    A node told to stop takes what has already arrived, flushes and sends its END marks, so that
    those after it finish too.
    """
    by_key: dict[str, list[Lane]] = {}
    for lane in lanes:
        for key in lane.inputs:
            by_key.setdefault(key, []).append(lane)
    quiet_since, stopping_since = time.monotonic(), None
    while not all(lane.runner.ended for lane in lanes):
        received = node.inbox.receive(0.1)
        if received is not None:
            quiet_since = time.monotonic()
            node.note_input(received.message.header)
            for lane in by_key.get(received.key, ()):
                lane.feed(received)
        elif node.stop.is_set():
            break
        if stopping_since is None and node.stop.is_set():
            stopping_since = time.monotonic()
        if stopping_since and time.monotonic() - stopping_since > LINGER_S:
            break
        if received is None and time.monotonic() - quiet_since > GIVE_UP_S:
            for lane in lanes:
                lane.give_up(node)
    for lane in lanes:
        while not lane.runner.ended:
            for message in lane.runner.end(Header(run_id=node.run_id)):
                lane.publisher.send(message)
