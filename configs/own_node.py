"""A node to begin with: raises an alarm when the grid of a camera leaves its usual band.

rsenf contract --reads cam1/track --sends cam1/alarm -- python configs/own_node.py
nodes: {band: {kind: external, command: [python, configs/own_node.py],
               reads: [cam1/track], sends: [cam1/alarm]}}
"""

from __future__ import annotations

from rsenf.bus.keys import camera_key
from rsenf.messages import Alarm, EnfEstimate
from rsenf.run.node import NodeProcess
from rsenf.run.own_node import run_own_node

BAND_HZ = 0.2


class Band:
    """A stage: estimates in, alarms out. It knows nothing of the bus, so it is easy to test."""

    def __init__(self) -> None:
        self.sent = 0

    def update(self, estimate: EnfEstimate) -> list[Alarm]:
        """Take an estimate; return an alarm when it is outside."""
        away_hz = abs(estimate.enf_hz - estimate.nominal_hz)
        if not estimate.usable or away_hz <= BAND_HZ:
            return []
        header = estimate.header.numbered(self.sent)
        self.sent += 1
        return [Alarm(header=header, kind="enf_outside", value=away_hz, limit=BAND_HZ, unit="Hz")]


def body(node: NodeProcess) -> None:
    """Read, decide, send, until told to stop."""
    site = node.graph.site
    stages, publishers = {}, {}
    for topic in node.config.reads:
        camera = topic.split("/")[0]
        key = node.subscribe(camera_key(site, *topic.split("/")))
        stages[key], publishers[key] = Band(), node.publisher(camera, "alarm")
    node.ready()
    while not node.stop.is_set():
        received = node.inbox.receive(0.1)
        if received is not None and not received.message.header.is_end:
            node.note_input(received.message.header)
            for alarm in stages[received.key].update(received.message):
                publishers[received.key].send(alarm)


if __name__ == "__main__":
    run_own_node(body)
