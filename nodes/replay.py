"""Replay: a recording in, any of its topics out."""

from __future__ import annotations

import contextlib

from rsenf.bus.bus import Publisher
from rsenf.bus.keys import REFERENCE, topic_of
from rsenf.config.node_kinds import ReplayNode
from rsenf.errors import EXIT_LOSS
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.outlets import Outlet, open_frames
from rsenf.run.replay.control import Control
from rsenf.run.replay.in_graph import player_of
from rsenf.run.replay.naming import FRAMES


def body(node: NodeProcess) -> None:
    """Play to the end, or until told to stop."""
    config: ReplayNode = node.config
    player = player_of(config, node.graph.site, run_id=node.run_id, control=Control(node.stop))
    with contextlib.ExitStack() as stack:
        frames: dict[str, Outlet] = {}
        publishers: dict[str, Publisher] = {}
        for key in player.keys:
            _, _, camera, topic = key.split("/")
            if topic_of(key) == FRAMES:
                frames[key] = open_frames(node, config, camera)
                stack.callback(frames[key].close)
            elif topic_of(key) == REFERENCE:
                publishers[key] = node.reference_publisher(topic)
            else:
                publishers[key] = node.publisher(camera, topic)
        node.ready()
        node.wait_for_peers()
        for key, message in player:
            node.note_input(message.header)
            if key in publishers:
                publishers[key].send(message)
            elif message.header.is_end:
                frames[key].finish(message.header.numbered(message.header.seq - 1))
            else:
                frames[key].send(message)
    if player.loss:
        node.exit_code = EXIT_LOSS
    node.say("running", player.loss)


if __name__ == "__main__":
    run_node(body)
