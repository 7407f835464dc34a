"""The schema of a graph file: nodes with their settings, bus, hosts and access rules."""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import BaseModel, Field, PrivateAttr

from rsenf.bus.keys import REFERENCE, matches
from rsenf.config.node_kind import (
    NODE_KINDS,
    Input,
    Name,
    NodeKind,
    Problem,
    Restart,
    Stream,
    Strict,
)
from rsenf.stage import StageSpec

if TYPE_CHECKING:
    Node = NodeKind
else:
    _KINDS = tuple(NODE_KINDS.usable().values())
    Node = Annotated[Union[_KINDS], Field(discriminator="kind")]  # noqa: UP007


def _variables(settings: BaseModel) -> Iterator[str]:
    """Yield the environment variables that settings name: all that end with ``_env``."""
    for name, value in settings:
        for one in value if isinstance(value, (list, tuple)) else (value,):
            if isinstance(one, BaseModel):
                yield from _variables(one)
            elif one and name.endswith("_env"):
                yield one


class BusConfig(Strict):
    """How the nodes reach each other. Empty: the run opens its own router, for this host only."""

    connect: tuple[str, ...] = Field((), description="endpoints of an existing router or of peers")
    listen: tuple[str, ...] = Field((), description="endpoints that the run's own router opens")
    mode: Literal["client", "peer"] = "client"
    multicast: bool = False
    largest_mb: float = Field(64.0, gt=0, description="larger messages are refused, and counted")
    zenoh: dict[str, Any] = Field({}, description="any Zenoh settings by path, for example TLS")

    @property
    def is_elsewhere(self) -> bool:
        """Whether the bus is an existing one, not the run's own router."""
        return bool(self.connect) or self.multicast


class HostConfig(Strict):
    """One of the hosts of a distributed graph: it runs its nodes, and a router for them."""

    nodes: tuple[Name, ...] = Field((), description="which run here; none: a router alone")
    address: str | None = Field(
        None, description="endpoint that other hosts link to: tcp/192.0.2.7:7447, or tls/NAME:7447"
    )
    listen: tuple[str, ...] = Field(
        (), description="endpoints to open for them, where these differ from the address"
    )
    links: tuple[Name, ...] = Field((), description="hosts to link to, by their address")


class TlsConfig(Strict):
    """Certificates for mutual TLS between hosts: paths, in which {host} is the host's name."""

    ca: str = Field(description="certificate of the authority that signs all others")
    certificate: str = Field(description="of this host; its common name is the host's name")
    key: str = Field(description="private key of this host")


class Access(Strict):
    """What the owner of a certificate who is no host of the graph may send; all may listen."""

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
    on_record_loss: Literal["stop", "alarm"] = Field(
        "alarm", description="when a recorder has died for good, or its disk is full"
    )
    nodes: dict[Name, Node] = Field(min_length=1)
    _environment: dict[str, str] = PrivateAttr(default_factory=dict)

    def hold_environment(self) -> None:
        """Note digests of the variables that nodes name, to see when a value has changed."""
        for name in {name for node in self.nodes.values() for name in _variables(node)}:
            value = os.environ.get(name, "").encode()
            self._environment[name] = hashlib.sha256(value).hexdigest()

    def environment_of(self, name: str) -> dict[str, str]:
        """Return the digests of a node's variables, as they were when the graph was loaded."""
        return {v: self._environment.get(v, "") for v in _variables(self.nodes[name])}

    def restart_of(self, name: str) -> Restart | None:
        """Return a node's restart policy, or else the graph's; None for no restarts."""
        return self.nodes[name].restart or self.restart

    def sender(self, topic: str, of: str) -> NodeKind | None:
        """Return the node that sends a camera's topic or a grid's reference; None if there is none.

        Parameters
        ----------
        topic : str
        of : str
            Camera, or grid for the topic 'reference'.
        """
        return self.nodes.get(sender_of(self, topic, of))

    def inputs_of(self, node: NodeKind) -> list[Input]:
        """Return the inputs of a node: all required ones, and the optional ones that are sent."""
        return [
            read for read in node.inputs() if not read.optional or sender_of(self, *read.stream)
        ]

    def reads_of(self, node: NodeKind, stage: StageSpec, camera: str) -> list[Stream]:
        """Return the streams that a stage of a node reads in this graph for a camera."""
        reads = [node.input_of(topic, camera).stream for topic in stage.reads]
        return [s for s in reads if s.topic not in stage.optional or sender_of(self, *s)]

    def mirrors(self, node: NodeKind) -> Iterator[Problem]:
        """Yield a problem for each camera that would be compared with itself, and always match."""
        sender = self.sender(REFERENCE, getattr(node, "grid", ""))
        for read in sender.inputs() if sender and not sender.program() else ():
            if read.stream.topic == "track" and read.stream.of in node.feeds:
                text = f"the reference {node.grid!r} is {read.stream.of!r}, compared with itself"  # type: ignore[attr-defined]  # it has read one
                yield ("cameras",), text


def host_of(graph: Graph, node: str) -> str:
    """Return the host that a node runs on; '' if none is assigned."""
    return next((name for name, host in graph.hosts.items() if node in host.nodes), "")


def elsewhere(graph: Graph, node: str) -> set[str]:
    """Return the nodes that run on other hosts than a node."""
    here = host_of(graph, node)
    return {name for name in graph.nodes if host_of(graph, name) != here}


def sender_of(graph: Graph, topic: str, of: str) -> str:
    """Return the name of the node that sends a camera's topic or a grid's reference; or ''.

    Parameters
    ----------
    graph : Graph
    topic : str
    of : str
        Camera, or grid for the topic 'reference'.
    """
    wanted = Stream(topic, of)
    return next((name for name, node in graph.nodes.items() if wanted in node.outputs()), "")


def reader_of_frames(graph: Graph, camera: str) -> str:
    """Return the name of the node that samples a camera's frames; '' if there is none."""
    return next(
        (
            name
            for name, node in graph.nodes.items()
            if camera in node.feeds and any("frames" in stage.reads for stage in node.stages())
        ),
        "",
    )


def readers_of(graph: Graph, name: str) -> set[str]:
    """Return the nodes that read, or record, what a node sends."""
    sent = graph.nodes[name].outputs()
    return {
        other
        for other, node in graph.nodes.items()
        if any(read.stream in sent for read in node.inputs())
        or any(matches(expr, str(stream)) for expr in node.records for stream in sent)
    } - {name}


def recorded_by(graph: Graph, name: str) -> list[str]:
    """Return the cameras of which a node records something."""
    records = graph.nodes[name].records
    sent = (stream for node in graph.nodes.values() for stream in node.outputs())
    of_cameras = (stream for stream in sent if stream.topic != REFERENCE)
    found = (s.of for s in of_cameras if any(matches(expr, str(s)) for expr in records))
    return list(dict.fromkeys(found))


def runs_ahead(graph: Graph, camera: str) -> bool:
    """Whether a camera's frames come from a file faster than real time."""
    sender = graph.sender("frames", camera)
    return sender is not None and sender.runs_ahead


def source_waits(graph: Graph, camera: str) -> bool:
    """Whether a camera's source waits for its readers: a file at full speed, say.

    A source outside this graph is not known to wait.
    """
    senders = [graph.sender(topic, camera) for topic in ("rows", "frames")]
    return any(sender is not None and sender.waits for sender in senders)


def completed(graph: Graph) -> Graph:
    """Return a graph in which row samplers have the settings that their readers need."""
    nodes = dict(graph.nodes)
    for node in graph.nodes.values():
        needed = node.rows_needed()
        for camera in node.feeds if needed else ():
            name = sender_of(graph, "rows", camera)
            rows = getattr(nodes.get(name), "rows", None)
            if rows is not None:
                settings = dataclasses.replace(rows, **needed)
                nodes[name] = nodes[name].model_copy(update={"rows": settings})
    return graph.model_copy(update={"nodes": nodes})
