"""Foxglove: everything on the bus, live, to whoever connects by WebSocket."""

from __future__ import annotations

import time

from rsenf.bus.delivery import LOOKING
from rsenf.bus.keys import ROOT, health_key
from rsenf.config.node_kinds import FoxgloveNode
from rsenf.run.foxglove_bridge import FoxgloveBridge
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import POLL_S
from rsenf.run.recording import Ending


def body(node: NodeProcess) -> None:
    """Serve until every stream of the graph has ended, or until told to stop."""
    config: FoxgloveNode = node.config
    site = node.graph.site
    with FoxgloveBridge(config.host, config.port, f"rsenf {site}", time.time_ns) as bridge:
        key_exprs = [f"{ROOT}/{site}/{below}" for below in config.topics]
        for key_expr in (*key_exprs, health_key(site, "*")):
            node.subscribe(key_expr, LOOKING)
        ending = Ending(node, key_exprs)
        node.ready()
        node.say("running", f"ws://{config.host}:{bridge.port}")
        while not ending.reached():
            received = node.inbox.receive(POLL_S)
            if received is not None:
                node.note_input(received.message.header)
                bridge.send(received.key, received.message, received.payload)
                ending.note(received.key, received.message.header)


if __name__ == "__main__":
    run_node(body)
