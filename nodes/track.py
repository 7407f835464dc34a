"""Track: row means in, ENF estimates out."""

from __future__ import annotations

from rsenf.bus.keys import camera_key
from rsenf.config.node_kinds import TrackNode
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import Lane, pump
from rsenf.run.runner import Runner
from rsenf.track import make_tracker


def body(node: NodeProcess) -> None:
    """Track every camera's ENF until all have ended."""
    config: TrackNode = node.config
    lanes = []
    for camera in config.cameras:
        key = node.subscribe(camera_key(node.graph.site, camera, "rows"))
        lanes.append(
            Lane(
                runner=Runner("track", lambda: make_tracker(config.track)),
                publisher=node.publisher(camera, "track"),
                inputs={key: node.sender_of("rows", camera)},
            )
        )
    node.ready()
    pump(node, lanes)


if __name__ == "__main__":
    run_node(body)
