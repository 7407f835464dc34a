"""What a graph file tells the dashboard: cameras, their nodes, and whether liveness is judged."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rsenf.bus.keys import ROOT
from rsenf.config import Graph


@dataclass(frozen=True)
class Wiring:
    """Contents of a graph file; the defaults stand for no graph file.

    Attributes
    ----------
    nodes : dict
        Names of the nodes that serve each feed, in the order of the file.
    judged : frozenset of str or None
        Feeds whose liveness a node judges; None if unknown.
    in_ring : tuple of str
        Feeds whose frames are in shared memory of some host.
    archive : Path or None
        Folder with recordings of alarms.
    claimed_ns : dict
        Claimed start times, UTC in ns, of feeds that aren't live (files or simulations).
    """

    nodes: dict[str, list[str]] = field(default_factory=dict)
    judged: frozenset[str] | None = None
    in_ring: tuple[str, ...] = ()
    archive: Path | None = None
    claimed_ns: dict[str, int] = field(default_factory=dict)


def key_expressions(wiring: Wiring) -> list[str]:
    """Return further keys to subscribe to: frames in shared memory, which cost no bandwidth."""
    return [f"{ROOT}/{feed}/frames" for feed in wiring.in_ring]


def wiring_of(graph: Graph, archive: str | None = None) -> Wiring:
    """Return the wiring of a graph.

    Parameters
    ----------
    graph : Graph
    archive : str, optional
        Folder of recordings; by default that of the graph's record node.
    """
    nodes: dict[str, list[str]] = {}
    for name, node in graph.nodes.items():
        sent = [of for topic, of in node.outputs() if topic != "reference"]
        for camera in dict.fromkeys([*node.feeds, *sent]):
            nodes.setdefault(f"{graph.site}/{camera}", []).append(name)
    nodes_of = list(graph.nodes.values())
    every = [stream for node in nodes_of for stream in node.outputs()]
    folders = [archive, *(getattr(node, "archive", None) for node in nodes_of)]
    folder = next(filter(None, folders), None)
    return Wiring(
        nodes,
        frozenset(f"{graph.site}/{camera}" for topic, camera in every if topic == "live"),
        tuple(f"{graph.site}/{of}" for n in nodes_of if n.uses_ring for of in n.feeds),
        Path(folder) if folder else None,
        {
            f"{graph.site}/{camera}": start_utc_ns
            for node in nodes_of
            for camera in node.feeds
            if (start_utc_ns := getattr(node, "start_utc_ns", 0))
        },
    )
