"""Match: ENF estimates and a grid's reference in, times of recording out."""

from __future__ import annotations

from rsenf.bus.keys import camera_key, reference_key
from rsenf.config.node_kinds import MatchNode
from rsenf.match.stage import Match
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import Lane, pump
from rsenf.run.runner import Runner


def body(node: NodeProcess) -> None:
    """Compare every camera with the reference until all have ended."""
    config: MatchNode = node.config
    # One that is to stay doesn't end for a series that doesn't fit; a file's run does.
    stays = len(config.cameras) > 1 or node.graph.restart_of(node.name) is not None

    def refused(why: str) -> None:
        node.inbox.counters.rejected += 1
        node.say("running", f"not compared: {why}")

    def make_stage() -> Match:
        return Match(
            method=config.method,
            grid=config.grid,
            interim_every_s=config.interim_every_s,
            settings=config.match,
            keep_hours=config.keep_hours,
            on_refused=refused if stays else None,
        )

    site, grid = node.graph.site, config.grid
    reference = node.subscribe(reference_key(site, grid))
    lanes = []
    for camera in config.cameras:
        key = node.subscribe(camera_key(site, camera, "track"))
        lanes.append(
            Lane(
                runner=Runner("match", make_stage, inputs=2),
                publisher=node.publisher(camera, "match"),
                inputs={
                    key: node.sender_of("track", camera),
                    reference: node.sender_of("reference", grid),
                },
            )
        )
    node.ready()
    pump(node, lanes)


if __name__ == "__main__":
    run_node(body)
