"""Idle: row means in, estimates of the camera's idle period out."""

from __future__ import annotations

from rsenf.bus.keys import camera_key
from rsenf.config.node_kinds import IdleNode
from rsenf.idle import make_idle
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import Lane, TellingLane, pump
from rsenf.run.runner import Runner


def body(node: NodeProcess) -> None:
    """Estimate every camera's idle period until all have ended."""
    config: IdleNode = node.config
    lanes: list[Lane] = []
    latest: dict[str, str] = {}
    for camera in config.cameras:
        key = node.subscribe(camera_key(node.graph.site, camera, "rows"))
        lanes.append(
            TellingLane(
                runner=Runner("idle", lambda: make_idle(config.idle)),
                publisher=node.publisher(camera, "idle"),
                inputs={key: node.sender_of("rows", camera)},
                node=node,
                camera=camera,
                latest=latest,
            )
        )
    node.ready()
    pump(node, lanes)


if __name__ == "__main__":
    run_node(body)
