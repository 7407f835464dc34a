"""Track: row means in, ENF estimates out, and idle estimates where they are asked for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from rsenf.bus.bus import Publisher
from rsenf.bus.keys import camera_key
from rsenf.config.node_kinds import TrackNode
from rsenf.messages import IdleEstimate
from rsenf.run.following import FollowingStages
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import Lane, TellingLane, pump
from rsenf.run.runner import Branches, Runner
from rsenf.track import make_tracker


@dataclass(kw_only=True)
class BothLane(TellingLane):
    """A lane of two topics: estimates of the ENF, and of the idle period, of which it tells.

    Parameters
    ----------
    idle : Publisher
    """

    idle: Publisher

    def send(self, messages: Iterable[Any]) -> None:
        """Send each message to its topic."""
        for message in messages:
            if isinstance(message, IdleEstimate):
                self.idle.send(message)
                self.tell(message)
            else:
                self.publisher.send(message)


def body(node: NodeProcess) -> None:
    """Track every camera's ENF until all have ended."""
    config: TrackNode = node.config
    lanes: list[Lane] = []
    latest: dict[str, str] = {}
    for camera in config.cameras:
        key = node.subscribe(camera_key(node.graph.site, camera, "rows"))
        inputs = {key: node.sender_of("rows", camera)}
        publisher = node.publisher(camera, "track")
        if config.idle is None:
            runner = Runner("track", lambda: make_tracker(config.track))
            lanes.append(Lane(runner=runner, publisher=publisher, inputs=inputs))
            continue
        make = FollowingStages(config.track, config.idle)
        lanes.append(
            BothLane(
                runner=Branches(Runner("track", make.tracker), Runner("idle", make.idle)),
                publisher=publisher,
                idle=node.publisher(camera, "idle"),
                inputs=inputs,
                node=node,
                camera=camera,
                latest=latest,
            )
        )
    node.ready()
    pump(node, lanes)


if __name__ == "__main__":
    run_node(body)
