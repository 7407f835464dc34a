"""The schema of a graph file: which nodes, with which settings, on which bus."""

from __future__ import annotations

from typing import Any, Literal, TypeVar

from pydantic import (
    Field,
)

from rsenf.bus.keys import (
    REFERENCE,
    renamed,
)
from rsenf.config.names import Name
from rsenf.config.node_kinds import (
    DecodeNode,
    DiscoverNode,
    ExternalNode,
    IdleNode,
    LiveNode,
    MatchNode,
    Node,
    ReferenceNode,
    ReplayNode,
    RowsNode,
    SimulatedInput,
    TrackNode,
)
from rsenf.config.supervised import Restart, Strict
from rsenf.decode.spec import kind_of

N = TypeVar("N")


class BusConfig(Strict):
    """How the nodes reach each other. Empty: a router of the run's own, on this host only."""

    connect: tuple[str, ...] = Field((), description="endpoints of an existing router or of peers")
    listen: tuple[str, ...] = Field((), description="endpoints that the run's own router opens")
    mode: Literal["client", "peer"] = "client"
    multicast: bool = False
    largest_mb: float = Field(64.0, gt=0, description="larger messages are refused, and counted")
    zenoh: dict[str, Any] = Field({}, description="any Zenoh settings by path, for example TLS")

    @property
    def is_elsewhere(self) -> bool:
        """Whether the bus is somebody else's, rather than a router of the run's own."""
        return bool(self.connect) or self.multicast


class HostConfig(Strict):
    """One of the hosts that a graph is split over: it runs its nodes, and a router for them."""

    nodes: tuple[Name, ...] = Field((), description="which run here; none: a router alone")
    address: str | None = Field(
        None, description="endpoint that other hosts link to: tcp/192.0.2.7:7447, or tls/NAME:7447"
    )
    listen: tuple[str, ...] = Field(
        (), description="endpoints to open for them, where these differ from the address"
    )
    links: tuple[Name, ...] = Field((), description="hosts to link to, by their address")


class TlsConfig(Strict):
    """Certificates that hosts show each other: paths, in which {host} is the host's name."""

    ca: str = Field(description="certificate of the authority that signs all others")
    certificate: str = Field(description="of this host; its common name is the host's name")
    key: str = Field(description="private key of this host")


class Access(Strict):
    """What somebody with a certificate may send who is no host of the graph; all may listen."""

    publish: tuple[str, ...] = Field((), description="key expressions below the site")


class Graph(Strict):
    """A whole graph."""

    version: Literal[1] = Field(description="version of this file's format")
    site: Name
    bus: BusConfig = BusConfig()
    hosts: dict[Name, HostConfig] = Field({}, description="that the nodes are split over")
    tls: TlsConfig | None = Field(None, description="certificates for the links between hosts")
    access: dict[Name, Access] = Field(
        {}, description="who else may send what, by the common name of the certificate"
    )
    restart: Restart | None = Field(
        None, description="when nodes are started again; without, a death is the run's failure"
    )
    nodes: dict[Name, Node] = Field(min_length=1)

    def of(self, kind: type[N]) -> list[N]:
        """Return the nodes of a kind, in the order of the file."""
        return [n for n in self.nodes.values() if isinstance(n, kind)]

    def restart_of(self, name: str) -> Restart | None:
        """Return when a node is started again: its own rule, or else the graph's."""
        return self.nodes[name].restart or self.restart


def host_of(graph: Graph, node: str) -> str:
    """Host that a node runs on; '' where the graph isn't split."""
    return next((name for name, host in graph.hosts.items() if node in host.nodes), "")


def elsewhere(graph: Graph, node: str) -> set[str]:
    """Nodes that run on other hosts than a node."""
    here = host_of(graph, node)
    return {name for name in graph.nodes if host_of(graph, name) != here}


def outputs(node: Any) -> list[tuple[str, str]]:
    """Return what a node sends: pairs of topic and camera, or 'reference' and grid."""
    if isinstance(node, DecodeNode):
        topics = ["rows"] if node.frames == "fused" else ["frames"]
        return [(t, node.camera) for t in [*topics, *(["video"] if node.record_video else [])]]
    if isinstance(node, ReferenceNode):
        return [(REFERENCE, node.grid)]
    if isinstance(node, ReplayNode):
        sent = [renamed(topic, node.rename).split("/") for topic in node.topics]
        return [(REFERENCE, b) if a == REFERENCE else (b, a) for a, b in sent]
    if isinstance(node, ExternalNode):
        sent = [topic.split("/") for topic in node.sends]
        return [(REFERENCE, b) if a == REFERENCE else (b, a) for a, b in sent]
    if isinstance(node, TrackNode) and node.idle:
        return [(topic, camera) for camera in node.cameras for topic in ("track", "idle")]
    if isinstance(node, RowsNode | TrackNode | IdleNode | DiscoverNode | MatchNode):
        return [(node.kind, camera) for camera in node.cameras]
    if isinstance(node, LiveNode):
        return [(topic, camera) for camera in node.cameras for topic in ("live", "alarm")]
    return []


def sender_of(graph: Graph, topic: str, name: str) -> str:
    """Node that sends a camera's topic or a grid's reference; '' when none of this graph does."""
    return next((n for n, node in graph.nodes.items() if (topic, name) in outputs(node)), "")


def beside_rows(graph: Graph, camera: str) -> list[str]:
    """Topics of a camera, beside its rows, that its liveness is judged by: those that are sent."""
    return ["track", *(["idle"] if sender_of(graph, "idle", camera) else [])]


def runs_ahead(graph: Graph, camera: str) -> bool:
    """Whether a camera's frames come from a file faster than they were filmed."""
    node = graph.nodes.get(sender_of(graph, "frames", camera))
    if not isinstance(node, DecodeNode) or node.pace:
        return False
    return isinstance(node.input, SimulatedInput) or kind_of(node.input) == "file"


def reader_of_frames(graph: Graph, camera: str) -> str:
    """Node that samples a camera's frames; '' when none of this graph does."""
    return next(
        (
            n
            for n, node in graph.nodes.items()
            if isinstance(node, RowsNode) and camera in node.cameras
        ),
        "",
    )
