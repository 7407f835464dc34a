"""Live: rows, estimates and a grid's reference in; verdicts on liveness and alarms out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rsenf.bus.bus import Publisher
from rsenf.bus.keys import camera_key, reference_key
from rsenf.config.graph import LiveNode, beside_rows
from rsenf.live import Live, Now
from rsenf.messages import Alarm, Header, Mark
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import Lane, TellingLane, pump
from rsenf.run.runner import Runner


@dataclass(kw_only=True)
class LiveLane(TellingLane):
    """A lane of two topics, whose stage is told the time: that no pictures come, nothing else says.

    Parameters
    ----------
    alarms : Publisher
    """

    alarms: Publisher
    _alarms_sent: int = 0

    def send(self, messages: Iterable[Any]) -> None:
        """Send each message to its topic, and end both."""
        for message in messages:
            if isinstance(message, Alarm):
                self.alarms.send(message)
                self._alarms_sent = message.header.seq + 1
                continue
            super().send([message])
            if message.header.is_end:
                end = message.header.numbered(self._alarms_sent, Mark.END)
                self.alarms.send(Alarm(header=end))

    def give_up(self, run_id: str, hopeless: Callable[[str], bool]) -> None:
        """Look at the clock as well."""
        now = Header(run_id=run_id, arrival_time_ns=time.time_ns())
        self.send(self.runner.feed(Now(now)))
        super().give_up(run_id, hopeless)


def body(node: NodeProcess) -> None:
    """Judge every camera until all have ended."""
    config: LiveNode = node.config
    site, grid = node.graph.site, config.grid
    reference = node.subscribe(reference_key(site, grid))
    lanes: list[Lane] = []
    latest: dict[str, str] = {}
    for camera in config.cameras:
        inputs = {reference: node.sender_of("reference", grid)}
        for topic in ("rows", *beside_rows(node.graph, camera)):
            key = node.subscribe(camera_key(site, camera, topic))
            inputs[key] = node.sender_of(topic, camera)
        lanes.append(
            LiveLane(
                runner=Runner(
                    "live",
                    lambda: Live(config.live, start_utc_ns=config.start_utc_ns),
                    inputs=len(inputs),
                ),
                publisher=node.publisher(camera, "live"),
                alarms=node.publisher(camera, "alarm"),
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
