"""Rows: frames in, row means of the steady pixels out."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.bus.frames import FrameReceiver
from rsenf.bus.inbox import Counters, Received
from rsenf.bus.keys import camera_key
from rsenf.config.graph import runs_ahead
from rsenf.config.node_kinds import RowsNode
from rsenf.errors import NodeFailed, SchemaMismatch
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import Lane, pump
from rsenf.run.row_sampling import make_rows
from rsenf.run.runner import Runner


@dataclass(kw_only=True)
class RowsLane(Lane):
    """A lane whose messages get their pixels from the ring, and give them back."""

    frames: FrameReceiver
    counters: Counters
    run_id: str

    def feed(self, received: Received) -> None:
        """Sample one frame; refuse one whose pixels aren't what it says (``SchemaMismatch``)."""
        try:
            frame = self.frames.open(received.message)
        except NodeFailed as exc:  # no such ring here; only one of this run has to be
            if received.message.header.run_id.partition(".")[0] == self.run_id:
                raise
            raise SchemaMismatch(str(exc)) from exc
        if frame is None:
            self.counters.dropped += 1
            return
        try:
            super().feed(Received(received.key, frame, received.payload))
        finally:
            self.frames.done()


def body(node: NodeProcess) -> None:
    """Sample every camera's frames until all have ended."""
    config: RowsNode = node.config
    lanes: list[Lane] = []
    for camera in config.cameras:
        key = node.subscribe(camera_key(node.graph.site, camera, "frames"))
        lanes.append(
            RowsLane(
                runner=Runner("rows", lambda: make_rows(config.rows)),
                publisher=node.publisher(camera, "rows"),
                inputs={key: node.sender_of("frames", camera)},
                ahead=runs_ahead(node.graph, camera),
                frames=FrameReceiver(),
                counters=node.inbox.counters,
                run_id=node.run_id,
            )
        )
    node.ready()
    pump(node, lanes)


if __name__ == "__main__":
    run_node(body)
