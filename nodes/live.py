"""Live: rows, estimates and a grid's reference in; verdicts on liveness and alarms out."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

# The stage needs it with its first verdict: loaded here, it doesn't keep pictures waiting then.
import scipy.linalg  # noqa: F401

from rsenf.bus.bus import Publisher
from rsenf.bus.keys import camera_key, reference_key, source_of
from rsenf.config.graph import beside_rows
from rsenf.config.node_kinds import LiveNode
from rsenf.live import Live, Silence
from rsenf.messages import Alarm, Header
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.peers import Peers
from rsenf.run.pump import Lane, TellingLane, pump
from rsenf.run.runner import Runner

# What a camera and those who read it may take to begin with, before its silence is told.
FIRST_PICTURE_S = 25.0


@dataclass(kw_only=True)
class LiveLane(TellingLane):
    """A lane of two topics, whose stage is told when no pictures come.

    Parameters
    ----------
    alarms : Publisher
    rows : str
        Key of the pictures.
    lost_s : float
        Without any for so long, the stage is told; infinite for files, which come when they can.
    """

    alarms: Publisher
    rows: str
    lost_s: float

    def send(self, messages: Iterable[Any]) -> None:
        """Send each message to its topic."""
        for message in messages:
            if isinstance(message, Alarm):
                self.alarms.send(message)
            else:
                super().send([message])

    def give_up(self, run_id: str, peers: Peers) -> None:
        """Notice silence as well."""
        now = time.monotonic()
        limit_s = self.lost_s if self.rows in self._begun else self.lost_s + FIRST_PICTURE_S
        if self.rows in self.inputs and now - self._heard.get(self.rows, now) > limit_s:
            header = Header(run_id=run_id, source=source_of(self.publisher.key))
            self.send(self.runner.feed(Silence(header)))
        super().give_up(run_id, peers)


def body(node: NodeProcess) -> None:
    """Judge every camera until all have ended."""
    config: LiveNode = node.config
    site, grid = node.graph.site, config.grid
    reference = node.subscribe(reference_key(site, grid))
    lanes: list[Lane] = []
    latest: dict[str, str] = {}
    for camera in config.cameras:
        inputs = {reference: node.sender_of("reference", grid)}
        rows = camera_key(site, camera, "rows")
        for topic in ("rows", *beside_rows(node.graph, camera)):
            key = node.subscribe(camera_key(site, camera, topic))
            inputs[key] = node.sender_of(topic, camera)
        lanes.append(
            LiveLane(
                runner=Runner(
                    "live",
                    lambda: Live(config.live, start_utc_ns=config.start_utc_ns),
                    inputs=len(inputs),
                    beside="alarm",
                ),
                publisher=node.publisher(camera, "live"),
                alarms=node.publisher(camera, "alarm"),
                rows=rows,
                lost_s=math.inf if config.start else config.live.lost_s,
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
