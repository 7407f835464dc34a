"""Base class of all kinds of nodes: a single declaration of everything about a kind; and names.

Fields are the settings in a graph file. Methods tell what the node reads and sends, what it
requires of other nodes, how its stages are made, and what its process does. Wiring, ``rsenf
validate``, supervision, recording, replay and regression use nothing else.

rsenf's own kinds are in ``nodes/``, one file each. Other packages add kinds by an entry point in
the group ``rsenf.nodes``; most derive from ``rsenf.run.stage_node.StageNode``.

The end of the file has the types of names in a graph file: of nodes, cameras and topics.
"""

from __future__ import annotations

import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from rsenf.bus.keys import NAME_PATTERN, NAME_RULE, REFERENCE, TOPICS, is_name, matches, topic_of
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
        20.0, ge=3, description="without heartbeat and health it counts as hung, and is killed"
    )
    stalled_s: float = Field(
        120.0, ge=3, description="as hung, too, if messages wait and none is taken or sent"
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
    shows_all : bool
        Whether it begins anew with any change of the graph, all of which it shows.
    """

    kind: str
    restart: Restart | None = Field(
        None, description="when it is started again; the graph's own rule unless given"
    )

    is_source: ClassVar[bool] = False
    sends_again: ClassVar[bool] = False
    named_by: ClassVar[str] = "cameras"
    shows_all: ClassVar[bool] = False

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
        "notify": "rsenf_nodes.notify:NotifyNode",
        "external": "rsenf_nodes.external:ExternalNode",
    },
    _check,
)


def named(text: str) -> str:
    """Return a name if it is valid as a part of a key; otherwise raise ValueError."""
    if not is_name(text):
        raise ValueError(f"no name: {NAME_RULE}")
    return text


def not_reserved(text: str) -> str:
    """Return a camera's name if it isn't reserved; otherwise raise ValueError."""
    if text == REFERENCE:
        raise ValueError(f"{REFERENCE!r} is taken: the references of the grids go by it")
    return text


def _topic(text: str) -> str:
    first, _, last = text.partition("/")
    camera_topics = [t for t in TOPICS if t not in (REFERENCE, "health")]
    if not (is_name(first) and is_name(last) and (first == REFERENCE or last in camera_topics)):
        known = ", ".join(camera_topics)
        raise ValueError(f"no topic: CAMERA/TOPIC with one of {known}; or {REFERENCE}/GRID")
    return text


def ensure_renamed(old: str, new: str, topics: tuple[str, ...] | None) -> None:
    """Check a renaming of a replay node, of one topic or of a whole camera.

    Parameters
    ----------
    old, new : str
        Both ``<camera>/<topic>`` or both ``<camera>``.
    topics : tuple of str or None
        Topics that the node plays; None for all.

    Raises
    ------
    ValueError
        When a name is invalid, isn't played, or belongs to another type of message.
    """
    is_topic = "/" in old
    for text in (old, new):
        try:
            _topic(text) if is_topic else not_reserved(named(text))
        except ValueError as exc:
            raise ValueError(f"{text!r} is {exc}") from exc
    known = {t if is_topic else t.split("/")[0] for t in topics or ()}
    if topics and old not in known:
        raise ValueError(f"{old!r} isn't among the topics, so it can't be renamed")
    if is_topic and topic_of(f"//{old}") != topic_of(f"//{new}"):
        raise ValueError(f"{old!r} can't be played as {new!r}: another message")


# One chunk of a key on the bus.
Name = Annotated[
    str,
    AfterValidator(named),
    Field(max_length=64, json_schema_extra={"pattern": f"^{NAME_PATTERN}$"}),
]
Camera = Annotated[Name, AfterValidator(not_reserved)]
# The part of a key after the site.
Topic = Annotated[str, AfterValidator(_topic)]
