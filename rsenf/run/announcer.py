"""What a supervisor publishes for nodes that can't: their states, and alarms of lost recorders."""

from __future__ import annotations

import dataclasses
import os
import socket
import time
from collections.abc import Iterable
from typing import Any

from rsenf.bus.bus import Bus, Publisher
from rsenf.bus.keys import HEALTH, camera_key, health_key, word_key
from rsenf.messages import Alarm, Header, Health
from rsenf.run.restart_policy import NodeState

# A node that hangs must not block its supervisor.
TELLING = dataclasses.replace(HEALTH, lossless=False)
AGAIN_S = 1.0


class Announcer:
    """Publishes for nodes.

    Parameters
    ----------
    bus : Bus
    site, run_id : str
        Of the run.
    """

    def __init__(self, bus: Bus, site: str, run_id: str) -> None:
        self._bus, self._site, self._run_id = bus, site, run_id
        self._publishers: dict[str, Publisher] = {}
        self._told_s: dict[str, float] = {}

    def tell(self, node: NodeState, state: str) -> None:
        """Publish the state of a node whose process has ended, to the other nodes, too."""
        health = dataclasses.replace(node.health or Health(), detail=node.detail)
        for key in (health_key, word_key):
            self._publish(key(self._site, node.name), self._of(node, health, state))

    def tell_held_up(self, node: NodeState, since_s: float, by: Iterable[str]) -> None:
        """Publish that a node lives whose health some reader holds up; once a second.

        Parameters
        ----------
        node : NodeState
        since_s : float
            Time since its last health.
        by : iterable of str
            Names of readers that may hold it up.
        """
        now_s = time.monotonic()
        if node.health is None or now_s - self._told_s.get(node.name, -AGAIN_S) < AGAIN_S:
            return
        self._told_s[node.name] = now_s
        named = ", ".join(by)
        text = f"its health is held up{' by ' if named else ''}{named} ({since_s:.0f} s)"
        detail = "; ".join(filter(None, (text, node.health.detail)))
        said = dataclasses.replace(node.health, detail=detail)
        self._publish(health_key(self._site, node.name), self._of(node, said, said.state))

    def raise_unrecorded(self, node: NodeState, cameras: Iterable[str], pts_ns: int) -> None:
        """Raise an alarm at each camera that a lost recorder recorded.

        Parameters
        ----------
        node : NodeState
            The recorder.
        cameras : iterable of str
        pts_ns : int
            Time of the loss by the run's clock.
        """
        for camera in cameras:
            header = Header(
                run_id=f"{self._run_id}.{node.name}",
                source=f"{self._site}/{camera}",
                pts_ns=pts_ns,
                arrival_time_ns=time.time_ns(),
            )
            alarm = Alarm(
                header=header, kind="unrecorded", severity="alarm",
                start_pts_ns=pts_ns, end_pts_ns=pts_ns, text=f"{node.name}: {node.detail}",
            )  # fmt: skip
            self._publish(camera_key(self._site, camera, "alarm"), alarm)

    def _of(self, node: NodeState, health: Health, state: str) -> Health:
        """Return health of a node as told by this process."""
        # A stream of its own, as a recording holds each number of a stream once.
        now_ns, run_id = time.time_ns(), f"{self._run_id}.supervisor"
        header = Header(run_id=run_id, source=node.name, arrival_time_ns=now_ns)
        return dataclasses.replace(
            health, header=header, node=node.name, kind=node.kind, state=state,
            restarts=node.restarts, pid=os.getpid(), host=socket.gethostname(), time_ns=now_ns,
        )  # fmt: skip

    def _publish(self, key: str, message: Any) -> None:
        """Number and send a message."""
        if key not in self._publishers:
            self._publishers[key] = self._bus.publisher(key, TELLING)
        publisher = self._publishers[key]
        header = message.header.numbered(publisher.sent)
        publisher.send(dataclasses.replace(message, header=header))
