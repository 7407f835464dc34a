"""Discover: row means in, verdicts on what a model lacks and on what changes out."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from threading import Event, Thread

from rsenf.bus.delivery import ROWS
from rsenf.bus.keys import camera_key
from rsenf.config.graph import Graph, outputs
from rsenf.config.model_file import load_model
from rsenf.config.node_kinds import DecodeNode, DiscoverNode, ReplayNode
from rsenf.decode.spec import kind_of
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.watch import WatchStage
from rsenf.discrepancy.window import Look
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import POLL_S, Lane, TellingLane, pump
from rsenf.run.runner import Runner

# Rows of a live camera that wait, from which on a verdict is skipped: at twice as many the camera
# would be made to wait, and with it everybody else who reads it.
BEHIND = ROWS.queue // 2


def body(node: NodeProcess) -> None:
    """Watch every camera until all have ended."""
    config: DiscoverNode = node.config
    model = load_model(Path(config.model)) if config.model else PLAIN
    lanes: list[Lane] = []
    latest: dict[str, str] = {}
    for camera in config.cameras:
        key = node.subscribe(camera_key(node.graph.site, camera, "rows"))
        waits = _waits(node.graph, camera)

        def make_stage(waits: bool = waits) -> WatchStage:
            return WatchStage(
                config.discover,
                model,
                is_behind=lambda: not waits and node.inbox.depth > BEHIND,
                run=lambda work: _unless_stopped(work, node.stop),
            )

        lanes.append(
            TellingLane(
                runner=Runner("discover", make_stage),
                publisher=node.publisher(camera, "discover"),
                inputs={key: node.sender_of("rows", camera)},
                node=node,
                camera=camera,
                latest=latest,
            )
        )
    node.ready()
    pump(node, lanes)


def _waits(graph: Graph, camera: str) -> bool:
    """Whether a camera is a recording, or the simulator, that comes as fast as it is taken."""
    if any((t, camera) in outputs(n) for n in graph.of(ReplayNode) for t in ("frames", "rows")):
        return True  # at any rate: a replay is exact
    for node in graph.of(DecodeNode):
        if node.camera == camera:
            url = node.input if isinstance(node.input, str) else ""
            return not (node.pace or url.startswith("v4l2:") or kind_of(url) != "file")
    return False  # of a bus of others nobody knows


def _unless_stopped(work: Callable[[], Look], stop: Event) -> Look | None:
    """Do what may take many seconds; give it up when the node is told to stop."""
    done: Future[Look] = Future()

    def do() -> None:
        try:
            done.set_result(work())
        except Exception as exc:  # noqa: BLE001 - raised again where it is waited for
            done.set_exception(exc)

    Thread(target=do, name="discover", daemon=True).start()
    while not stop.is_set():
        with contextlib.suppress(TimeoutError):
            return done.result(POLL_S)
    return None


if __name__ == "__main__":
    run_node(body)
