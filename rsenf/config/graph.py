"""The schema of a graph file: which nodes, with which settings, on which bus."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
)

from rsenf.bus.keys import (
    NAME_PATTERN,
    NAME_RULE,
    REFERENCE,
    ROOT,
    TOPICS,
    is_name,
    renamed,
    topic_of,
)
from rsenf.config.supervised import Restart, Strict, Supervised
from rsenf.discrepancy.settings import WatchSettings
from rsenf.idle.settings import IdleSettings
from rsenf.live.settings import LiveSettings
from rsenf.match.settings import MatchSettings
from rsenf.record.settings import AlarmSettings, DiskLimits, Retention, Rotation
from rsenf.rows.settings import RowsSettings
from rsenf.timebase import since_1970_ns
from rsenf.track.settings import TrackSettings

N = TypeVar("N")
_REFERENCE_KEY = f"{ROOT}/{NAME_PATTERN}/{REFERENCE}/{NAME_PATTERN}"


def _named(text: str) -> str:
    if not is_name(text):
        raise ValueError(f"no name: {NAME_RULE}")
    return text


def _not_reserved(text: str) -> str:
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


def _one_by_another(old: str, new: str, topics: tuple[str, ...] | None) -> None:
    """Check new names of a replay node, which are of a topic or of a whole camera."""
    is_topic = "/" in old
    for text in (old, new):
        try:
            _topic(text) if is_topic else _not_reserved(_named(text))
        except ValueError as exc:
            raise ValueError(f"{text!r} is {exc}") from exc
    known = {t if is_topic else t.split("/")[0] for t in topics or ()}
    if topics and old not in known:
        raise ValueError(f"{old!r} isn't among the topics, so it can't be renamed")
    if is_topic and topic_of(f"//{old}") != topic_of(f"//{new}"):
        raise ValueError(f"{old!r} can't be played as {new!r}: another message")


# Part of a key on the bus.
Name = Annotated[
    str,
    AfterValidator(_named),
    Field(max_length=64, json_schema_extra={"pattern": f"^{NAME_PATTERN}$"}),
]
Camera = Annotated[Name, AfterValidator(_not_reserved)]
# What follows the site in a key.
Topic = Annotated[str, AfterValidator(_topic)]


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


class SimulatedInput(Strict):
    """The simulator in place of a camera."""

    model: str = Field(description="model file")
    reference: str | None = Field(None, description="grid frequency to film; synthetic without")
    start_s: float = Field(0.0, ge=0)
    duration_s: float = Field(60.0, gt=0)
    seed: int = 1
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)


# Told apart by their form, so that a problem in one isn't reported as two.
Input = Annotated[
    Annotated[str, Tag("path")] | Annotated[SimulatedInput, Tag("simulated")],
    Discriminator(lambda read: "simulated" if isinstance(read, dict | BaseModel) else "path"),
]


class DecodeNode(Supervised):
    """Opens a video, a camera or the simulator, and sends its frames."""

    kind: Literal["decode"]
    camera: Camera
    input: Input = Field(description="path, rtsp://…, v4l2:/dev/video0, or a simulated input")
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
    backoff_initial_s: float = Field(1.0, gt=0, description="before it is tried again; doubled")
    backoff_max_s: float = Field(30.0, gt=0, description="the longest pause between attempts")
    wait_for_source: bool = Field(False, description="begin although the camera isn't there yet")


class ReplayNode(Supervised):
    """Puts topics of a recording back on the bus."""

    kind: Literal["replay"]
    input: str = Field(description="MCAP recording")
    topics: tuple[Topic, ...] = Field(
        min_length=1, description="as recorded: cam1/rows; cam1/frames decodes the video again"
    )
    rename: dict[str, str] = Field({}, description="new names by old: of cameras, or of topics")
    rate: float = Field(0.0, ge=0, description="of its speed; 0: as fast as the others take it")
    start_s: float = Field(0.0, ge=0)
    end_s: float | None = Field(None, gt=0)
    loop: int = Field(1, ge=0, description="times to play it; 0: until stopped")
    frames: Literal["ring", "tcp"] = Field("ring", description="shared memory, or over the bus")
    ring_slots: int = Field(8, ge=2, le=256)

    @field_validator("rename")
    @classmethod
    def _can_be_renamed(cls, rename: dict[str, str], info: ValidationInfo) -> dict[str, str]:
        for old, new in rename.items():
            _one_by_another(old, new, info.data.get("topics"))
        return rename


class RowsNode(Supervised):
    """Takes row means of the steady pixels."""

    kind: Literal["rows"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    rows: RowsSettings = RowsSettings()


class TrackNode(Supervised):
    """Estimates the ENF."""

    kind: Literal["track"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    track: TrackSettings = TrackSettings()


class IdleNode(Supervised):
    """Estimates the idle period of the cameras."""

    kind: Literal["idle"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    idle: IdleSettings = IdleSettings()


class DiscoverNode(Supervised):
    """Watches for what a model of the cameras lacks, and names what changes."""

    kind: Literal["discover"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    model: str | None = Field(None, description="model file to begin with; a plain lamp without")
    discover: WatchSettings = WatchSettings()


class ReferenceNode(Supervised):
    """Publishes a grid's frequency: of a file, of the store, or as it is measured."""

    kind: Literal["reference"]
    grid: Name
    input: str = Field(
        description="path, store:GRID[@STEP][?from=TIME&to=TIME], camera:NAME, sound:[DEVICE], "
        "or topic:rsenf/SITE/reference/GRID"
    )
    follow: bool = Field(False, description="the file, CSV or WAV, grows: go on with it")
    store: str | None = Field(None, description="folder of the store; the user's when not given")
    timezone: str | None = None
    step_s: float | None = Field(None, gt=0)
    column: str | None = None
    nominal_hz: float | None = None
    stamp: Literal["start", "centre"] = "start"

    @field_validator("input")
    @classmethod
    def _can_be_named(cls, read: str) -> str:
        kind, _, name = read.partition(":")
        if kind == "camera":
            _not_reserved(_named(name))
        if kind == "topic" and not re.fullmatch(_REFERENCE_KEY, name):
            raise ValueError(f"no key of a reference: {ROOT}/SITE/{REFERENCE}/GRID")
        return read

    @property
    def feed(self) -> tuple[str, str]:
        """What goes on measuring, and its name: ('camera', NAME); ('', '') when nothing does."""
        kind, _, name = self.input.partition(":")
        if kind in ("camera", "sound", "topic"):
            return kind, name
        return ("file", self.input) if self.follow else ("", "")


class MatchNode(Supervised):
    """Compares ENF with a reference."""

    kind: Literal["match"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    grid: Name
    method: str = "phase"
    interim_every_s: float = Field(0.0, ge=0, description="0: a result at the end only")
    keep_hours: float = Field(
        24.0, ge=0, description="of estimates, and of a growing reference, to go by; 0: all"
    )
    match: MatchSettings = MatchSettings()


class LiveNode(Supervised):
    """Tells whether feeds are live: whether their flicker follows the grid now."""

    kind: Literal["live"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    grid: Name
    start: datetime | None = Field(
        None, description="when a file's or a simulation's first picture was taken, UTC"
    )
    live: LiveSettings = LiveSettings()

    @property
    def start_utc_ns(self) -> int:
        """The same in ns since 1970; 0 to go by when pictures arrive."""
        return since_1970_ns(self.start) if self.start else 0


class RecordNode(Supervised):
    """Writes topics to an MCAP file, or to an archive of such files."""

    kind: Literal["record"]
    out: str | None = Field(None, description="file; or 'archive'")
    archive: str | None = Field(None, description="folder of files by site, camera and day")
    topics: tuple[str, ...] = Field(("**",), description="key expressions below the site")
    overwrite: bool = False
    flush_every_s: float = Field(0.5, gt=0, le=60)
    compress: bool = True
    rotation: Rotation = Field(Rotation(), description="when an archive's next file begins")
    retention: Retention = Field(Retention(), description="what of an archive is deleted")
    alarms: AlarmSettings = Field(AlarmSettings(), description="what an archive keeps about them")
    disk: DiskLimits = Field(DiskLimits(), description="how little of it may be left")


class ExternalNode(Supervised):
    """Somebody's own program, under supervision; 'rsenf explain contract' tells what it owes."""

    kind: Literal["external"]
    command: tuple[str, ...] = Field(min_length=1, description="program and its arguments")
    reads: tuple[Topic, ...] = Field((), description="such as cam1/track; told in RSENF_READS")
    sends: tuple[Topic, ...] = Field((), description="that nobody else sends; in RSENF_SENDS")


class FoxgloveNode(Supervised):
    """Shows topics live in Foxglove, which connects by WebSocket."""

    kind: Literal["foxglove"]
    host: str = Field("127.0.0.1", description="address to listen at; this host alone unless given")
    port: int = Field(8765, ge=0, le=65535, description="0: any that is free")
    topics: tuple[str, ...] = Field(("**",), description="key expressions below the site")


class DashboardNode(Supervised):
    """Shows all feeds on a web page."""

    kind: Literal["dashboard"]
    host: str = Field("127.0.0.1", description="address to listen at; this host alone unless given")
    port: int = Field(8780, ge=0, le=65535, description="0: any that is free")
    topics: tuple[str, ...] = Field(
        ("*/rows", "*/track", "*/idle", "*/match", "*/live", "*/alarm", "*/video", "reference/*"),
        description="key expressions below the site",
    )
    archive: str | None = Field(
        None, description="folder of alarms' recordings; the record node's unless given"
    )


Node = Annotated[
    DecodeNode
    | ReplayNode
    | RowsNode
    | TrackNode
    | IdleNode
    | DiscoverNode
    | ReferenceNode
    | MatchNode
    | LiveNode
    | RecordNode
    | FoxgloveNode
    | DashboardNode
    | ExternalNode,
    Field(discriminator="kind"),
]


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
