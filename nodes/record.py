"""Record: everything on the bus into one MCAP file."""

from __future__ import annotations

import sys
import threading
import time

from rsenf.bus.inbox import Received
from rsenf.bus.keys import ROOT, health_key
from rsenf.config.graph import RecordNode
from rsenf.record.provenance import input_facts
from rsenf.record.writer import Recorder
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.recording import DELIVERY, Ending, input_files, record_until, run_info

HASH_LINGER_S = 0.8


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
        for key_expr in config.topics:
            node.subscribe(f"{ROOT}/{node.graph.site}/{key_expr}", DELIVERY)
        node.subscribe(health_key(node.graph.site, "*"), DELIVERY)
        ending = Ending(node)
        hashes: list[dict[str, str]] = []
        hashing = threading.Thread(
            target=lambda: hashes.extend(input_facts(p) for p in input_files(node.graph)),
            daemon=True,
        )
        hashing.start()
        node.ready()

        def note(received: Received) -> None:
            node.note_input(received.message.header)
            ending.note(received.key, received.message.header)

        record_until(recorder, node.inbox, ending.reached, note)
        hashing.join(HASH_LINGER_S)
        for facts in hashes:
            recorder.add_metadata("rsenf.input", facts)
        node.say("running", f"{config.out}: {node.inbox.counters.received} messages")


if __name__ == "__main__":
    sys.exit(run_node(body))
