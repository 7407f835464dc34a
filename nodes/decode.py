"""Decode: a video, a camera or the simulator in, frames and compressed packets out."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, Discriminator, Field, Tag, model_validator

from rsenf.config.node_kind import Camera, Input, NodeKind, Stream
from rsenf.config.schemas import SimulatedInput
from rsenf.decode.source import EffortChoice, SourceSpec, kind_of
from rsenf.errors import UsageError
from rsenf.rows.settings import RowsSettings
from rsenf.run.stages import rows_stage
from rsenf.stage import ALONE, StageContext, StageSpec

if TYPE_CHECKING:
    from rsenf.decode.source import VideoSource
    from rsenf.run.node import NodeProcess
    from rsenf.run.outlets import Outlet

# Discriminated by type, so that a mistake isn't reported for both alternatives.
Source = Annotated[
    Annotated[str, Tag("path")] | Annotated[SimulatedInput, Tag("simulated")],
    Discriminator(lambda read: "simulated" if isinstance(read, dict | BaseModel) else "path"),
]


class DecodeNode(NodeKind):
    """Opens a video, a camera or the simulator, and sends its frames."""

    kind: Literal["decode"]
    camera: Camera
    input: Source = Field(description="path, rtsp://…, v4l2:/dev/video0, or a simulated input")
    frames: Literal["ring", "tcp", "fused"] = Field(
        "ring", description="shared memory, over the bus, or rows taken in this process"
    )
    rows: RowsSettings = Field(RowsSettings(), description="row sampling, when fused")
    record_video: bool = Field(True, description="send the compressed packets, for recording")
    frame_rate_hz: float | None = Field(
        None, gt=0, description="at which a file's frames are counted, in place of its own times"
    )
    pace: bool = Field(False, description="play a file at its own speed, as if live")
    threads: int = Field(0, ge=0, description="decoder threads; 0 is what keeps all cores busy")
    effort: EffortChoice = Field(
        "auto", description="fast: without the loop filter; auto: so while a feed is too fast"
    )
    hwaccel: str = Field("none", description="device to decode on: auto, none, vaapi, cuda, …")
    ring_slots: int = Field(8, ge=2, le=256)
    open_timeout_s: float = Field(10.0, gt=0)
    read_timeout_s: float = Field(10.0, gt=0)
    max_reconnects: int | None = Field(None, ge=0, description="live sources; none: keep trying")
    backoff_initial_s: float = Field(1.0, gt=0, description="before it is tried again; doubled")
    backoff_max_s: float = Field(30.0, gt=0, description="the longest pause between attempts")
    wait_for_source: bool = Field(False, description="begin although the camera isn't there yet")

    is_source = True
    named_by = "camera"

    @model_validator(mode="after")
    def _only_files_lack_times(self) -> DecodeNode:
        if self.frame_rate_hz and not self._is_file:
            raise ValueError("frame_rate_hz is for files: any other input has times of its own")
        return self

    @property
    def _is_file(self) -> bool:
        return isinstance(self.input, str) and kind_of(self.input) == "file"

    @property
    def feeds(self) -> tuple[str, ...]:
        """Its camera."""
        return (self.camera,)

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the rows stage if it runs in this process (``frames: fused``)."""
        return [rows_stage(self.rows)] if self.frames == "fused" else []

    def inputs(self) -> list[Input]:
        """Return nothing: frames come from outside the graph."""
        return []

    def outputs(self) -> list[Stream]:
        """Return frames or rows, and video packets if they are recorded."""
        topics = ["rows" if self.frames == "fused" else "frames"]
        topics += ["video"] if self.record_video else []
        return [Stream(topic, self.camera) for topic in topics]

    @property
    def runs_ahead(self) -> bool:
        """Whether it is a file or the simulator at full speed."""
        return not self.pace and (isinstance(self.input, SimulatedInput) or self._is_file)

    def body(self, node: NodeProcess) -> None:
        """Send every frame of the source, then the END marks."""
        from rsenf.errors import EXIT_LOSS
        from rsenf.messages import Frame, Header, Mark, VideoPacket

        with contextlib.ExitStack() as stack:
            source = stack.enter_context(self._source(node))
            outlet = self._outlet(node, live=source.info.live)
            stack.callback(outlet.close)
            live = source.info.live or self.pace
            far = live and bool(node.graph.hosts)
            video = node.publisher(self.camera, "video", live=far) if self.record_video else None
            node.ready()
            if source.warnings:
                node.say("running", "; ".join(source.warnings))
            node.wait_for_peers(live=live)
            node.count_waiting(lambda: source.backlog[0])
            frame = packet = Header(
                run_id=node.run_id, source=f"{node.graph.site}/{self.camera}", seq=-1
            )
            for item in source:
                node.inbox.counters.dropped = source.backlog[1]
                if isinstance(item, Frame):
                    frame = item.header
                    node.note_input(frame)
                    outlet.send(item)
                elif video:
                    packet = item.header
                    video.send(item, more=True)
                if node.stop.is_set():
                    break
            outlet.finish(frame)
            if video:
                video.send(VideoPacket(header=packet.numbered(packet.seq + 1, Mark.END)))
            if source.loss:
                node.exit_code = EXIT_LOSS
            node.say("running", "; ".join(filter(None, [source.loss, *source.warnings])))

    def _outlet(self, node: NodeProcess, *, live: bool) -> Outlet:
        from rsenf.run.outlets import Fused, open_frames

        ahead = not (live or self.pace)
        if self.frames == "fused":
            (stage,) = self.stages()
            return Fused(stage, node.publisher(self.camera, "rows"), ahead=ahead)
        ring, slots = self.uses_ring, self.ring_slots
        return open_frames(node, self.camera, ring=ring, slots=slots, live=live, ahead=ahead)

    def _source(self, node: NodeProcess) -> VideoSource:
        name = f"{node.graph.site}/{self.camera}"
        if isinstance(self.input, SimulatedInput):
            from rsenf.run.simulated import open_simulated

            return open_simulated(self.input, name, node.run_id, pace=self.pace, stop=node.stop)
        from rsenf.decode.source import open_source
        from rsenf.run.process import HostClock

        if not self.input:
            raise UsageError(f"camera {self.camera!r} has no input", "is its variable set?")
        spec = SourceSpec(
            url=self.input.removeprefix("v4l2:"),
            kind=kind_of(self.input),
            threads=self.threads,
            effort=self.effort,
            hwaccel=self.hwaccel,
            frame_rate_hz=self.frame_rate_hz,
            with_packets=self.record_video,
            pace=self.pace,
            open_timeout_s=self.open_timeout_s,
            read_timeout_s=self.read_timeout_s,
            max_reconnects=self.max_reconnects,
            backoff_initial_s=self.backoff_initial_s,
            backoff_max_s=self.backoff_max_s,
            wait_for_source=self.wait_for_source,
        )

        def say(line: str) -> None:
            node.say("running", line)

        def event(line: str) -> None:
            # A lost camera may send nothing for hours, so batched messages are sent now. Called in
            # the sending thread, as flush requires, unlike the clock's callback.
            node.flush()
            say(line)

        return open_source(
            spec,
            source=name,
            run_id=node.run_id,
            clock_ns=HostClock(say),
            stop=node.stop,
            on_event=event,
        )
