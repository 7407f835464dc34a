"""Record: topics of the bus in, one MCAP file or an archive of them out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from rsenf.bus.keys import ROOT, health_key
from rsenf.config.node_kind import NodeKind, Problem, bad_key_expressions
from rsenf.config.schemas import RecordSettings

if TYPE_CHECKING:
    from rsenf.bus.inbox import Received
    from rsenf.config.graph import Graph
    from rsenf.run.node import NodeProcess


class RecordNode(NodeKind, RecordSettings):
    """Writes topics to an MCAP file, or to an archive of such files."""

    kind: Literal["record"]

    @property
    def writes(self) -> str:
        """The output file; empty for an archive."""
        return self.out or ""

    @property
    def records(self) -> tuple[str, ...]:
        """The recorded topics."""
        return self.topics

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield invalid key expressions, and settings that mix a file and an archive."""
        named = [("topics", key_expr) for key_expr in self.topics]
        yield from bad_key_expressions([*named, ("alarms", self.alarms.trigger)])
        if (self.out is None) == (self.archive is None):
            yield (), "name a file with 'out', or a folder with 'archive': one of the two"
        for key in ("rotation", "retention", "alarms"):
            if self.out is not None and key in self.model_fields_set:
                yield (key,), f"{key} is of an archive; name a folder with 'archive', not a file"

    def body(self, node: NodeProcess) -> None:
        """Write until every stream of the graph has ended, or until told to stop."""
        from rsenf.record.archive import ArchiveRecorder
        from rsenf.run.recording import (
            DELIVERY,
            AlarmWatch,
            Ending,
            InputHashes,
            alarm_keys,
            disk_guard,
            open_sink,
            record_backlog,
            record_until,
            run_info,
        )

        def warn(text: str) -> None:
            node.say("running", text)

        graph = node.graph
        key_exprs = [f"{ROOT}/{graph.site}/{below}" for below in self.topics]
        alarming = alarm_keys(self, graph.site)
        # Before its files are opened, which may take a while: video is sent once.
        for key_expr in (*key_exprs, *alarming, health_key(graph.site, "*")):
            node.subscribe(key_expr, DELIVERY)
        with open_sink(self, run_info(node), warn, node.restarts) as sink:
            alarms = AlarmWatch(sink, alarming)
            ending, hashes = Ending(node, key_exprs), InputHashes(node.graph)
            guard = disk_guard(self, warn)

            def note(received: Received) -> None:
                node.note_input(received.message.header)
                ending.note(received.key, received.message.header)
                alarms.note(received)

            def ended() -> bool:
                nonlocal graph
                alarms.check()
                if node.graph is not graph:  # exchanged
                    graph = node.graph
                    if isinstance(sink, ArchiveRecorder):
                        sink.update_run_info(run_info(node))
                return ending.reached()

            if node.restarts:
                node.inbox.resume(sink.resumed)
                record_backlog(sink, node.inbox, guard, note)
            node.ready()
            with alarms.on_signal():
                record_until(sink, node.inbox, ended, guard, note)
            for name, facts in hashes.facts(node.stop).items():
                sink.add_metadata(f"rsenf.input.{name}", facts)
        node.say("running", f"{sink.path}: {node.inbox.counters.received} messages")
