"""The kinds of nodes that a graph may have, and the settings of each."""

from __future__ import annotations

import re
from datetime import datetime
from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
)

from rsenf.bus.keys import NAME_PATTERN, REFERENCE, ROOT
from rsenf.config.names import Camera, Name, Topic, ensure_renamed, named, not_reserved
from rsenf.config.supervised import Strict, Supervised
from rsenf.discrepancy.settings import WatchSettings
from rsenf.idle.settings import IdleSettings
from rsenf.live.settings import LiveSettings
from rsenf.match.settings import MatchSettings
from rsenf.record.settings import AlarmSettings, DiskLimits, Retention, Rotation
from rsenf.rows.settings import RowsSettings
from rsenf.timebase import since_1970_ns
from rsenf.track.settings import TrackSettings

_REFERENCE_KEY = f"{ROOT}/{NAME_PATTERN}/{REFERENCE}/{NAME_PATTERN}"


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
    threads: int = Field(0, ge=0, description="decoder threads; 0 is what keeps all cores busy")
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
            ensure_renamed(old, new, info.data.get("topics"))
        return rename


class RowsNode(Supervised):
    """Takes row means of the steady pixels."""

    kind: Literal["rows"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    rows: RowsSettings = RowsSettings()


class TrackNode(Supervised):
    """Estimates the ENF, and the idle period along with it where that is asked for."""

    kind: Literal["track"]
    cameras: tuple[Camera, ...] = Field(min_length=1)
    track: TrackSettings = TrackSettings()
    idle: IdleSettings | None = Field(
        None,
        description="send idle estimates, too: cheaper than by a node of their own; {} for them",
    )


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
            not_reserved(named(name))
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
    interim_every_s: float = Field(
        0.0, ge=0, description="0: a result at the end only; of long clips, after a quarter more"
    )
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
