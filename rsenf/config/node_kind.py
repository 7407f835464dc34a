"""Base class of all kinds of nodes: a single declaration of everything about a kind.

Fields are the settings in a graph file. Methods tell what the node reads and sends, what it
requires of other nodes, how its stages are made, and what its process does. Wiring, ``rsenf
validate``, supervision, recording, replay and regression use nothing else.

rsenf's own kinds are in ``nodes/``, one file each. Other packages add kinds by an entry point in
the group ``rsenf.nodes``; most derive from ``rsenf.run.stage_node.StageNode``.
"""

from __future__ import annotations

import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rsenf.bus.keys import REFERENCE, matches
from rsenf.errors import UsageError
from rsenf.registry import Registry
from rsenf.stage import ALONE, StageContext, StageSpec

if TYPE_CHECKING:
    from rsenf.config.graph import Graph

Problem = tuple[tuple[str, ...], str]  # keys below the node in the file, and the message


class Strict(BaseModel):
    """Base of all settings: unknown keys are errors, and instances are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Restart(Strict):
    """When a node that crashes or hangs is restarted."""

    limit: int = Field(5, ge=0, description="times within within_s; after that it stays dead")
    within_s: float = Field(300.0, gt=0)
    backoff_s: float = Field(0.5, gt=0, description="pause before the first; doubles each time")
    backoff_max_s: float = Field(30.0, gt=0, description="longest pause")
    silent_s: float = Field(
        20.0, ge=3, description="without a word of its health it counts as hung, and is killed"
    )
    stalled_s: float = Field(
        120.0, ge=3, description="as hung, too, if messages wait and it takes and sends none"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Restart:
        if self.backoff_max_s < self.backoff_s:
            raise ValueError(f"backoff_max_s {self.backoff_max_s:g} is below backoff_s")
        return self


class Stream(NamedTuple):
    """A topic of a camera, or the reference of a grid."""

    topic: str
    of: str

    @classmethod
    def below(cls, text: str) -> Stream:
        """Parse the part of a key after the site: ``cam1/rows`` or ``reference/ce``."""
        first, _, last = text.partition("/")
        return cls(REFERENCE, last) if first == REFERENCE else cls(last, first)

    def __str__(self) -> str:
        return f"{self.topic}/{self.of}" if self.topic == REFERENCE else f"{self.of}/{self.topic}"


class Input(NamedTuple):
    """A stream that a node reads.

    ``where`` is the node's setting that names it. An ``optional`` stream is read if it is sent.
    """

    stream: Stream
    where: str = "cameras"
    optional: bool = False


class NodeKind(Strict):
    """A kind of node.

    Attributes
    ----------
    is_source : bool
        Whether it is stopped before the nodes that read it.
    sends_again : bool
        Whether it is restarted along with a reader: it sends everything it has, and ends.
    named_by : str
        The setting that names what it sends.
    """

    kind: str
    restart: Restart | None = Field(
        None, description="when it is started again; the graph's own rule unless given"
    )

    is_source: ClassVar[bool] = False
    sends_again: ClassVar[bool] = False
    named_by: ClassVar[str] = "cameras"

    # --- what it reads and sends -----------------------------------------------------------

    @property
    def feeds(self) -> tuple[str, ...]:
        """Cameras that the node serves, in the order of the file."""
        return tuple(getattr(self, "cameras", ()))

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the stages that run for each camera; empty for a node without stages."""
        return []

    def outputs(self) -> list[Stream]:
        """Return the streams that it sends. Its process can't publish any other."""
        topics = [topic for stage in self.stages() for topic in stage.sends]
        return [self.input_of(topic, camera).stream for camera in self.feeds for topic in topics]

    def inputs(self) -> list[Input]:
        """Return the streams that it reads from other nodes of the graph."""
        found: dict[Stream, Input] = {}
        for camera in self.feeds:
            for stage in self.stages():
                for topic in stage.reads:
                    read = self.input_of(topic, camera, optional=topic in stage.optional)
                    found.setdefault(read.stream, read)
        return list(found.values())

    def input_of(self, topic: str, camera: str, *, optional: bool = False) -> Input:
        """Return the input that a topic means for a stage of a camera."""
        if topic == REFERENCE:
            return Input(Stream(topic, getattr(self, "grid", "")), "grid", optional)
        return Input(Stream(topic, camera), "cameras", optional)

    def rows_needed(self) -> Mapping[str, Any]:
        """Return the fields of ``RowsSettings`` that it depends on, with the required values."""
        return {}

    # --- what others ask -------------------------------------------------------------------

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield problems of the node or its place in the graph that the schema can't detect."""
        return iter(())

    def check_ready(self, name: str, site: str) -> None:
        """Raise an RsenfError for what would fail later. Called before any node is started."""

    @property
    def plays(self) -> str:
        """Recording that the node plays; empty for other nodes."""
        return ""

    @property
    def writes(self) -> str:
        """File that the node writes; empty for none."""
        return ""

    @property
    def records(self) -> tuple[str, ...]:
        """Key expressions, below the site, of what it records; empty for most nodes."""
        return ()

    @property
    def uses_ring(self) -> bool:
        """Whether it passes frames through shared memory."""
        return getattr(self, "frames", "") == "ring"

    @property
    def runs_ahead(self) -> bool:
        """Whether its frames come from a file faster than real time."""
        return False

    @property
    def waits(self) -> bool:
        """Whether it waits for its readers, instead of falling behind or dropping."""
        return self.runs_ahead

    # --- its process -----------------------------------------------------------------------

    def program(self) -> list[str]:
        """Return the command line of an external program; empty for rsenf's own nodes."""
        return []

    def body(self, node: Any) -> None:
        """Open the streams, call ``node.ready()``, and loop until done or ``node.stop`` is set.

        Parameters
        ----------
        node : rsenf.run.node.NodeProcess
            The process that runs the node.
        """
        raise UsageError(f"a {self.kind} node has no process of rsenf's", "'rsenf run' starts it")


def unknown(known: Registry[Any] | Mapping[str, Any], name: str) -> str:
    """Return the message for an unknown method, with the known ones."""
    return f"no method {name!r}; one of {', '.join(known)}"


def bad_key_expressions(named: Iterable[tuple[str, str]]) -> Iterator[Problem]:
    """Yield a problem for each setting that isn't a valid key expression.

    Parameters
    ----------
    named : iterable of (str, str)
        Names of settings, with their values.
    """
    for where, key_expr in named:
        try:
            matches(key_expr, "any")
        except UsageError as exc:
            yield (where,), str(exc)


def _check(name: str, kind: type[NodeKind]) -> None:
    if not (isinstance(kind, type) and issubclass(kind, NodeKind)):
        raise UsageError(f"{name} is no rsenf.config.node_kind.NodeKind")
    called = typing.get_args(kind.model_fields["kind"].annotation)
    if called != (name,):
        raise UsageError(f"{kind.__name__} is added as {name}", f'kind: Literal["{name}"] in it')


NODE_KINDS: Registry[type[NodeKind]] = Registry(
    "node kind",
    "rsenf.nodes",
    {
        "decode": "rsenf_nodes.decode:DecodeNode",
        "replay": "rsenf_nodes.replay:ReplayNode",
        "rows": "rsenf_nodes.rows:RowsNode",
        "track": "rsenf_nodes.track:TrackNode",
        "idle": "rsenf_nodes.idle:IdleNode",
        "discover": "rsenf_nodes.discover:DiscoverNode",
        "reference": "rsenf_nodes.reference:ReferenceNode",
        "match": "rsenf_nodes.match:MatchNode",
        "live": "rsenf_nodes.live:LiveNode",
        "record": "rsenf_nodes.record:RecordNode",
        "foxglove": "rsenf_nodes.foxglove:FoxgloveNode",
        "dashboard": "rsenf_nodes.dashboard:DashboardNode",
        "external": "rsenf_nodes.external:ExternalNode",
    },
    _check,
)
