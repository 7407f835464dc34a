"""A node to start from: raises an alarm when a camera's ENF leaves its normal band.

rsenf contract --reads cam1/track --sends cam1/alarm -- python own_node.py
nodes: {band: {kind: external, command: [python, own_node.py],
               reads: [cam1/track], sends: [cam1/alarm]}}
"""

from __future__ import annotations

from rsenf.messages import Alarm, EnfEstimate
from rsenf.run.node import NodeProcess
from rsenf.run.own_node import run_own_node
from rsenf.run.pump import lane_of, pump
from rsenf.stage import StageSpec

BAND_HZ = 0.2


class Band:
    """A stage: estimates in, alarms out. It doesn't use the bus, so it is easy to test."""

    def __init__(self) -> None:
        self.sent = 0

    def update(self, estimate: EnfEstimate) -> list[Alarm]:
        """Take an estimate; return an alarm when it is outside the band."""
        away_hz = abs(estimate.enf_hz - estimate.nominal_hz)
        if not estimate.usable or away_hz <= BAND_HZ:
            return []
        header = estimate.header.numbered(self.sent)
        self.sent += 1
        return [Alarm(header=header, kind="enf_outside", value=away_hz, limit=BAND_HZ, unit="Hz")]

    def flush(self) -> list[Alarm]:
        """Return what the end of the stream completes: nothing here."""
        return []


def body(node: NodeProcess) -> None:
    """Watch every camera until all streams have ended, or until told to stop."""
    # The runner makes a new stage for each epoch, and sends an END mark at the end.
    band = StageSpec(sends=("alarm",), reads=("track",), make=Band)
    cameras = dict.fromkeys(read.split("/")[0] for read in node.config.reads)
    lanes = [lane_of(node, camera, [band]) for camera in cameras]
    node.ready()
    pump(node, lanes)


if __name__ == "__main__":
    run_own_node(body)
