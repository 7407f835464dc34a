"""References that go on, on the bus: who measures them, and the loop that publishes them."""

from __future__ import annotations

from rsenf.bus.keys import camera_key
from rsenf.config.graph import ReferenceNode
from rsenf.reference.live import CameraReference
from rsenf.run.node import NodeProcess
from rsenf.run.pump import Lane, pump
from rsenf.run.runner import Runner


def publish_feed(node: NodeProcess) -> None:
    """Publish what goes on measuring, until it ends or the node is told to stop."""
    config: ReferenceNode = node.config
    _, name = config.feed
    _from_camera(node, config, name)


def _from_camera(node: NodeProcess, config: ReferenceNode, camera: str) -> None:
    """Publish what a camera's estimates say; its rows tell when they were filmed."""
    site = node.graph.site
    step_s = config.step_s or 1.0
    lane = Lane(
        Runner("reference", lambda: CameraReference(config.grid, step_s, node.run_id), inputs=2),
        node.reference_publisher(config.grid),
        {
            node.subscribe(camera_key(site, camera, topic)): node.sender_of(topic, camera)
            for topic in ("rows", "track")
        },
    )
    node.ready()
    pump(node, [lane])
