"""What a graph file tells beforehand: which cameras, whose nodes, whether anybody judges them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rsenf.bus.keys import ROOT
from rsenf.config.graph import Graph, outputs
from rsenf.config.node_kinds import DecodeNode, LiveNode, RecordNode


@dataclass(frozen=True)
class Wiring:
    """What is known of a bus; nothing, where there is no graph file.

    Attributes
    ----------
    nodes : dict
        Names of the nodes that serve each feed, in the order of the file.
    judged : frozenset of str or None
        Feeds that a node gives verdicts on; None where that isn't known.
    in_ring : tuple of str
        Feeds whose frames lie in shared memory of some host.
    archive : Path or None
        Where recordings of alarms are.
    claimed_ns : dict
        When feeds that aren't live, files or simulations, are said to begin, UTC.
    """

    nodes: dict[str, list[str]] = field(default_factory=dict)
    judged: frozenset[str] | None = None
    in_ring: tuple[str, ...] = ()
    archive: Path | None = None
    claimed_ns: dict[str, int] = field(default_factory=dict)


def key_expressions(wiring: Wiring) -> list[str]:
    """Return what to subscribe to beside the topics: frames that cost nothing to look at."""
    return [f"{ROOT}/{feed}/frames" for feed in wiring.in_ring]


def wiring_of(graph: Graph, archive: str | None = None) -> Wiring:
    """Read a graph.

    Parameters
    ----------
    graph : Graph
    archive : str, optional
        Folder of recordings; that of the graph's own record node unless given.
    """
    nodes: dict[str, list[str]] = {}
    for name, node in graph.nodes.items():
        named = getattr(node, "cameras", None) or [getattr(node, "camera", None)]
        sent = [of for topic, of in outputs(node) if topic != "reference"]
        for camera in dict.fromkeys(filter(None, [*named, *sent])):
            nodes.setdefault(f"{graph.site}/{camera}", []).append(name)
    every = [pair for node in graph.nodes.values() for pair in outputs(node)]
    folders = [archive, *(record.archive for record in graph.of(RecordNode))]
    folder = next(filter(None, folders), None)
    return Wiring(
        nodes,
        frozenset(f"{graph.site}/{camera}" for topic, camera in every if topic == "live"),
        tuple(f"{graph.site}/{d.camera}" for d in graph.of(DecodeNode) if d.frames == "ring"),
        Path(folder) if folder else None,
        {
            f"{graph.site}/{camera}": live.start_utc_ns
            for live in graph.of(LiveNode)
            for camera in live.cameras
            if live.start_utc_ns
        },
    )
