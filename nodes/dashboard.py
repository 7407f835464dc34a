"""Dashboard: all feeds on a web page, live."""

from __future__ import annotations

import time

from rsenf.bus.delivery import LOOKING
from rsenf.bus.keys import ROOT, health_key
from rsenf.config.node_kinds import DashboardNode
from rsenf.dashboard.server import DashboardServer, open_to_all
from rsenf.dashboard.site import Site
from rsenf.dashboard.wiring import key_expressions, wiring_of
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.pump import POLL_S
from rsenf.run.recording import Ending


def body(node: NodeProcess) -> None:
    """Serve until every stream of the graph has ended, or until told to stop."""
    config: DashboardNode = node.config
    site = f"{ROOT}/{node.graph.site}"
    wiring = wiring_of(node.graph, config.archive)
    key_exprs = [f"{site}/{below}" for below in config.topics]
    with (
        Site(wiring, time.time_ns) as shown,
        DashboardServer(shown, config.host, config.port) as server,
    ):
        for key_expr in (*key_exprs, *key_expressions(wiring), health_key(node.graph.site, "*")):
            node.subscribe(key_expr, LOOKING)
        ending = Ending(node, key_exprs)
        node.ready()
        warning = open_to_all(config.host)
        node.say("running", "; ".join(filter(None, [server.url, warning])))
        while not ending.reached():
            received = node.inbox.receive(POLL_S)
            if received is not None:
                node.note_input(received.message.header)
                shown.update(received.key, received.message)
                ending.note(received.key, received.message.header)


if __name__ == "__main__":
    run_node(body)
