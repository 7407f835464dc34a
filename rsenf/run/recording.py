"""What a recording says of its run, and when it has everything."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from rsenf.bus.delivery import Delivery
from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.keys import camera_key, reference_key
from rsenf.config.graph import DecodeNode, Graph, ReferenceNode, SimulatedInput, outputs
from rsenf.messages import Header
from rsenf.record.writer import Recorder
from rsenf.run.node import NodeProcess

# How long a recording waits, told to stop, for streams to end; and for a sender that is gone.
STOP_LINGER_S = 0.8
# Recording waits for the disk, and its senders wait for it.
DELIVERY = Delivery(lossless=True, queue=512, history=600)
GONE_LINGER_S = 1.0


def run_info(node: NodeProcess) -> dict[str, str]:
    """Run, site and graph, as they go into the recording. Secrets are hidden."""
    return {"run_id": node.run_id, "site": node.graph.site, "config": node.graph_text}


def input_files(graph: Graph) -> list[Path]:
    """Files that a graph reads, for their hashes."""
    names = [n.input for n in graph.of(DecodeNode) if not isinstance(n.input, SimulatedInput)]
    names += [n.input for n in graph.of(ReferenceNode)]
    return [Path(name) for name in names if Path(name).is_file()]


class Ending:
    """Knows which streams are still open: those of the graph's own nodes, until their END mark.

    A node that is gone without an END mark is not waited for.
    """

    def __init__(self, node: NodeProcess) -> None:
        self._node = node
        self._open: dict[str, str] = {}
        self._quiet_since = time.monotonic()
        self._stop_since: float | None = None
        site = node.graph.site
        for name, config in node.graph.nodes.items():
            for topic, of in outputs(config):
                grid = topic == "reference"
                key = reference_key(site, of) if grid else camera_key(site, of, topic)
                self._open[key] = name
        self._endless = not self._open

    def note(self, key: str, header: Header) -> None:
        """Take in a message that was recorded."""
        self._quiet_since = time.monotonic()
        if header.is_end:
            self._open.pop(key, None)

    def reached(self) -> bool:
        """Whether there is nothing more to wait for."""
        now = time.monotonic()
        for key, name in list(self._open.items()):
            gone = self._node.peers.gone_for_s(name) > GONE_LINGER_S
            if gone and now - self._quiet_since > GONE_LINGER_S:
                del self._open[key]
        if self._node.stop.is_set():
            self._stop_since = self._stop_since or now
            return not self._open or now - self._stop_since > STOP_LINGER_S
        return not self._open and not self._endless and self._node.inbox.depth == 0


def record_until(
    recorder: Recorder,
    inbox: Inbox,
    ended: Callable[[], bool],
    on_message: Callable[[Received], None] = lambda received: None,
) -> None:
    """Write what an inbox receives until ``ended()`` says so.

    Parameters
    ----------
    recorder : Recorder
        The open recording.
    inbox : Inbox
        Where messages arrive.
    ended : callable
        Asked between messages.
    on_message : callable, optional
        Called after each message was written.
    """
    while not ended():
        received = inbox.receive(0.1)
        if received is None:
            recorder.tick()
            continue
        header = received.message.header
        recorder.write_encoded(received.key, type(received.message), received.payload, header)
        on_message(received)
