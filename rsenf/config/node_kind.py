"""What a kind of node is: one class, in one file, that says all that anybody needs to know of it.

Its fields are its settings in a graph file; its methods say what it reads and sends, what it needs
of others, how its stages are made, and what its process does. Wiring, ``rsenf validate``,
supervision, recording, replay and regression ask here and nowhere else.

rsenf's own are in ``nodes/``, one file each. Another package adds its own by an entry point in the
group ``rsenf.nodes``; ``rsenf.run.stage_node.StageNode`` is the base of most.
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

Problem = tuple[tuple[str, ...], str]  # keys below the node in the file, and what is wrong


class Strict(BaseModel):
    """Unknown keys are errors; what was read doesn't change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Restart(Strict):
    """When a node that dies, or hangs, is started again."""

    limit: int = Field(5, ge=0, description="times within within_s; after that it stays dead")
    within_s: float = Field(300.0, gt=0)
    backoff_s: float = Field(0.5, gt=0, description="pause before the first; doubles each time")
    backoff_max_s: float = Field(30.0, gt=0, description="longest pause")
    silent_s: float = Field(
        20.0, ge=3, description="without a word of its health it counts as hung, and is killed"
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
        """Read what follows the site in a key: ``cam1/rows`` or ``reference/ce``."""
        first, _, last = text.partition("/")
        return cls(REFERENCE, last) if first == REFERENCE else cls(last, first)

    def __str__(self) -> str:
        return f"{self.topic}/{self.of}" if self.topic == REFERENCE else f"{self.of}/{self.topic}"


class Input(NamedTuple):
    """A stream that a node reads.

    ``where`` is the node's key that names it. An ``optional`` one is read where it is sent.
    """

    stream: Stream
    where: str = "cameras"
    optional: bool = False


class NodeKind(Strict):
    """A kind of node.

    Attributes
    ----------
    is_source : bool
        Whether it is told to stop before those that read it.
    sends_again : bool
        Whether it is started once more for a reader that was: it sends all it has, and ends.
    named_by : str
        The node's key that says what it sends.
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
        """Cameras that it serves, in the order of the file."""
        return tuple(getattr(self, "cameras", ()))

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return what it does with each of its cameras; nothing for what has no stage."""
        return []

    def outputs(self) -> list[Stream]:
        """Return what it sends. Its process can open no other topic for sending."""
        topics = [topic for stage in self.stages() for topic in stage.sends]
        return [self.input_of(topic, camera).stream for camera in self.feeds for topic in topics]

    def inputs(self) -> list[Input]:
        """Return what it reads that others of the graph send."""
        found: dict[Stream, Input] = {}
        for camera in self.feeds:
            for stage in self.stages():
                for topic in stage.reads:
                    read = self.input_of(topic, camera, optional=topic in stage.optional)
                    found.setdefault(read.stream, read)
        return list(found.values())

    def input_of(self, topic: str, camera: str, *, optional: bool = False) -> Input:
        """Return what a stage of a camera reads under a topic."""
        if topic == REFERENCE:
            return Input(Stream(topic, getattr(self, "grid", "")), "grid", optional)
        return Input(Stream(topic, camera), "cameras", optional)

    def rows_needed(self) -> Mapping[str, Any]:
        """Return fields of ``RowsSettings`` without which it can do nothing, and their values."""
        return {}

    # --- what others ask -------------------------------------------------------------------

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield what is wrong with it, or with its place in a graph, that its fields can't tell."""
        return iter(())

    def check_ready(self, name: str, site: str) -> None:
        """Raise an error of rsenf for what would fail later, before any node is started."""

    @property
    def plays(self) -> str:
        """Recording that its messages are of; empty for what makes them."""
        return ""

    @property
    def writes(self) -> str:
        """File that it writes; empty for none."""
        return ""

    @property
    def records(self) -> tuple[str, ...]:
        """Key expressions below the site of what it writes down; nothing for most."""
        return ()

    @property
    def uses_ring(self) -> bool:
        """Whether its frames lie in shared memory."""
        return getattr(self, "frames", "") == "ring"

    @property
    def runs_ahead(self) -> bool:
        """Whether its frames come from a file faster than they were filmed."""
        return False

    @property
    def waits(self) -> bool:
        """Whether it waits for those that read it, rather than fall behind or leave out."""
        return self.runs_ahead

    # --- its process -----------------------------------------------------------------------

    def program(self) -> list[str]:
        """Return the command line of somebody's own program; empty for a node of rsenf's."""
        return []

    def body(self, node: Any) -> None:
        """Open the streams, call ``node.ready()``, loop until done or until told to stop.

        Parameters
        ----------
        node : rsenf.run.node.NodeProcess
            Its process.
        """
        raise UsageError(f"a {self.kind} node has no process of rsenf's", "'rsenf run' starts it")


def unknown(known: Registry[Any] | Mapping[str, Any], name: str) -> str:
    """Say that there is no method of a name, and what there is."""
    return f"no method {name!r}; one of {', '.join(known)}"


def bad_key_expressions(named: Iterable[tuple[str, str]]) -> Iterator[Problem]:
    """Yield those of some keys of a node that hold no key expression."""
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
