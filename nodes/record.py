"""Record: everything on the bus into one MCAP file."""

from __future__ import annotations

import time

from rsenf.bus.inbox import Received
from rsenf.bus.keys import ROOT, health_key
from rsenf.config.graph import RecordNode
from rsenf.record.writer import Recorder
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.recording import DELIVERY, Ending, InputHashes, record_until, run_info


def body(node: NodeProcess) -> None:
    """Write until every stream of the graph has ended, or until told to stop."""
    config: RecordNode = node.config
    with Recorder(
        config.out,
        run_info=run_info(node),
        clock_ns=time.time_ns,
        flush_every_s=config.flush_every_s,
        compress=config.compress,
        overwrite=config.overwrite,
    ) as recorder:
        key_exprs = [f"{ROOT}/{node.graph.site}/{below}" for below in config.topics]
        for key_expr in (*key_exprs, health_key(node.graph.site, "*")):
            node.subscribe(key_expr, DELIVERY)
        ending, hashes = Ending(node, key_exprs), InputHashes(node.graph)
        node.ready()

        def note(received: Received) -> None:
            node.note_input(received.message.header)
            ending.note(received.key, received.message.header)

        record_until(recorder, node.inbox, ending.reached, note)
        for name, facts in hashes.facts(node.stop).items():
            recorder.add_metadata(f"rsenf.input.{name}", facts)
    node.say("running", f"{config.out}: {node.inbox.counters.received} messages")


if __name__ == "__main__":
    run_node(body)
