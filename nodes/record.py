"""Record: everything on the bus into one MCAP file, or into an archive of them."""

from __future__ import annotations

from rsenf.bus.inbox import Received
from rsenf.bus.keys import ROOT, health_key
from rsenf.config.node_kinds import RecordNode
from rsenf.run.alarms import AlarmWatch
from rsenf.run.node import NodeProcess, run_node
from rsenf.run.recording import (
    DELIVERY,
    Ending,
    InputHashes,
    disk_guard,
    of_run,
    open_sink,
    record_until,
    run_info,
)


def body(node: NodeProcess) -> None:
    """Write until every stream of the graph has ended, or until told to stop."""
    config: RecordNode = of_run(node.config, node.restarts)
    site = f"{ROOT}/{node.graph.site}"

    def warn(text: str) -> None:
        node.say("running", text)

    with open_sink(config, run_info(node), warn) as sink:
        alarms = AlarmWatch(sink, f"{site}/{config.alarms.trigger}")
        key_exprs = [f"{site}/{below}" for below in config.topics]
        for key_expr in (*key_exprs, *alarms.key_exprs, health_key(node.graph.site, "*")):
            node.subscribe(key_expr, DELIVERY)
        ending, hashes = Ending(node, key_exprs), InputHashes(node.graph)
        guard = disk_guard(config, warn)
        node.ready()

        def note(received: Received) -> None:
            node.note_input(received.message.header)
            ending.note(received.key, received.message.header)
            alarms.note(received)

        def ended() -> bool:
            alarms.check()
            return ending.reached()

        with alarms.on_signal():
            record_until(sink, node.inbox, ended, guard, note)
        for name, facts in hashes.facts(node.stop).items():
            sink.add_metadata(f"rsenf.input.{name}", facts)
    node.say("running", f"{sink.path}: {node.inbox.counters.received} messages")


if __name__ == "__main__":
    run_node(body)
