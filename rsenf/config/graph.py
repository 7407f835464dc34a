"""The schema of a graph file: which nodes, with which settings, on which bus."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from rsenf.bus.keys import is_name
from rsenf.match.settings import MatchSettings
from rsenf.rows.settings import RowsSettings
from rsenf.track.settings import TrackSettings

N = TypeVar("N")


_NAMES = "letters, digits, '-', '_' and '.', beginning with a letter or digit"
_READS = {"rows": "frames", "track": "rows", "match": "track"}

Name = Annotated[str, Field(min_length=1, max_length=64)]


class Strict(BaseModel):
    """Unknown keys are errors; what was read doesn't change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BusConfig(Strict):
    """How the nodes reach each other. Empty: a router of the run's own, on this host only."""

    connect: tuple[str, ...] = Field((), description="endpoints of an existing router or of peers")
    listen: tuple[str, ...] = Field((), description="endpoints that the run's own router opens")
    mode: Literal["client", "peer"] = "client"
    multicast: bool = False
    zenoh: dict[str, Any] = Field({}, description="any Zenoh settings by path, for example TLS")


class SimulatedInput(Strict):
    """The simulator in place of a camera."""

    model: str = Field(description="model file")
    reference: str | None = Field(None, description="grid frequency to film; synthetic without")
    start_s: float = Field(0.0, ge=0)
    duration_s: float = Field(60.0, gt=0)
    seed: int = 1
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)


class DecodeNode(Strict):
    """Opens a video, a camera or the simulator, and sends its frames."""

    kind: Literal["decode"]
    camera: Name
    input: str | SimulatedInput = Field(
        description="path, rtsp://…, v4l2:/dev/video0, or a simulated input"
    )
    frames: Literal["ring", "tcp", "fused"] = Field(
        "ring", description="shared memory, over the bus, or rows taken in this process"
    )
    rows: RowsSettings = Field(RowsSettings(), description="row sampling, when fused")
    record_video: bool = Field(True, description="send the compressed packets, for recording")
    pace: bool = Field(False, description="play a file at its own speed, as if live")
    threads: int = Field(0, ge=0, description="decoder threads; 0 lets FFmpeg choose")
    ring_slots: int = Field(8, ge=2, le=256)
    open_timeout_s: float = Field(10.0, gt=0)
    read_timeout_s: float = Field(10.0, gt=0)
    max_reconnects: int | None = Field(None, ge=0, description="live sources; none: keep trying")


class RowsNode(Strict):
    """Takes row means of the steady pixels."""

    kind: Literal["rows"]
    cameras: tuple[Name, ...] = Field(min_length=1)
    rows: RowsSettings = RowsSettings()


class TrackNode(Strict):
    """Estimates the ENF."""

    kind: Literal["track"]
    cameras: tuple[Name, ...] = Field(min_length=1)
    track: TrackSettings = TrackSettings()


class ReferenceNode(Strict):
    """Publishes a grid's frequency from a file."""

    kind: Literal["reference"]
    grid: Name
    input: str
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)
    column: str | None = None
    nominal_hz: float | None = None
    stamp: Literal["start", "centre"] = "start"


class MatchNode(Strict):
    """Compares ENF with a reference."""

    kind: Literal["match"]
    cameras: tuple[Name, ...] = Field(min_length=1)
    grid: Name
    method: str = "ncc"
    interim_every_s: float = Field(0.0, ge=0, description="0: a result at the end only")
    match: MatchSettings = MatchSettings()


class RecordNode(Strict):
    """Writes topics to an MCAP file."""

    kind: Literal["record"]
    out: str
    topics: tuple[str, ...] = Field(("**",), description="key expressions below the site")
    overwrite: bool = False
    flush_every_s: float = Field(0.5, gt=0, le=60)
    compress: bool = True


Node = Annotated[
    DecodeNode | RowsNode | TrackNode | ReferenceNode | MatchNode | RecordNode,
    Field(discriminator="kind"),
]


class Graph(Strict):
    """A whole graph."""

    version: Literal[1] = Field(description="version of this file's format")
    site: Name
    bus: BusConfig = BusConfig()
    nodes: dict[str, Node] = Field(min_length=1)

    def problems(self) -> list[tuple[tuple[str, ...], str]]:
        """What doesn't fit together: where in the file, and what."""
        named = [(("site",), self.site), *((("nodes", n), n) for n in self.nodes)]
        for name, node in self.nodes.items():
            if isinstance(node, DecodeNode):
                named.append((("nodes", name, "camera"), node.camera))
            if isinstance(node, ReferenceNode):
                named.append((("nodes", name, "grid"), node.grid))
        out = [(at, f"{text!r} is no name: {_NAMES}") for at, text in named if not is_name(text)]
        # With a bus of somebody else's, what is missing here may be sent there.
        return out if self.bus.connect else out + self._unfed()

    def _unfed(self) -> list[tuple[tuple[str, ...], str]]:
        """Return every node whose input nobody sends."""
        sent = {pair for node in self.nodes.values() for pair in outputs(node)}
        out: list[tuple[tuple[str, ...], str]] = []
        for name, node in self.nodes.items():
            if isinstance(node, RowsNode | TrackNode | MatchNode):
                topic = _READS[node.kind]
                for camera in node.cameras:
                    if (topic, camera) not in sent:
                        text = f"nobody sends the {topic} of camera {camera!r}"
                        out.append((("nodes", name, "cameras"), text))
            if isinstance(node, MatchNode) and ("reference", node.grid) not in sent:
                text = f"nobody sends the reference {node.grid!r}"
                out.append((("nodes", name, "grid"), text))
        return out

    def of(self, kind: type[N]) -> list[N]:
        """Return the nodes of a kind, in the order of the file."""
        return [n for n in self.nodes.values() if isinstance(n, kind)]

    @property
    def cameras(self) -> list[str]:
        """Cameras whose frames this graph opens."""
        return [n.camera for n in self.of(DecodeNode)]


def outputs(node: Any) -> list[tuple[str, str]]:
    """Return what a node sends: pairs of topic and camera, or 'reference' and grid."""
    if isinstance(node, DecodeNode):
        topics = ["rows"] if node.frames == "fused" else ["frames"]
        return [(t, node.camera) for t in [*topics, *(["video"] if node.record_video else [])]]
    if isinstance(node, ReferenceNode):
        return [("reference", node.grid)]
    if isinstance(node, RowsNode | TrackNode | MatchNode):
        return [(node.kind, camera) for camera in node.cameras]
    return []


def sender_of(graph: Graph, topic: str, name: str) -> str:
    """Node that sends a camera's topic or a grid's reference; '' when none of this graph does."""
    return next((n for n, node in graph.nodes.items() if (topic, name) in outputs(node)), "")
