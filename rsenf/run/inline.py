"""Runs the whole pipeline in one process at full speed, with the same stages as the nodes."""

from __future__ import annotations

import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.bus.keys import REFERENCE, TOPICS
from rsenf.flicker.slow_time import FrameCounter
from rsenf.idle import IdleSettings
from rsenf.messages import (
    Alarm,
    EnfEstimate,
    Frame,
    Header,
    IdleEstimate,
    Liveness,
    Mark,
    MatchResult,
    ReferenceBlock,
    RowBlock,
)
from rsenf.rows.settings import RowsSettings
from rsenf.run.inputs import Input
from rsenf.run.process import keep_heap
from rsenf.run.runner import Pipeline
from rsenf.run.stages import flicker_stages, live_stage, match_stage, rows_stage
from rsenf.stage import Stage, StageSpec
from rsenf.track import TrackSettings

Message = Frame | RowBlock | EnfEstimate


Tap = Callable[[str, Any], None]


@dataclass
class Analysis:
    """Results of a recording. A stretch is one epoch: a source that restarted has several.

    Attributes
    ----------
    estimates : list of EnfEstimate
        The tracker's first choices (rank 0), in order.
    idle_by_epoch : dict of IdleEstimate
        The last estimate of each stretch, by epoch.
    results : list of MatchResult
        One for each stretch.
    verdicts : list of Liveness
    alarms : list of Alarm
        Their ends included.
    stretches_s : list of float
        Duration of each stretch.
    row_reasons : Counter of str
        Number of row blocks by the reason why they are unusable; '' for usable ones.
    clocks : dict of FrameCounter
        Fitted to the frame times of each stretch, by epoch.
    frames, fast_frames : int
        Number of frames; of those, how many were decoded without the loop filter.
    lines, across_px : int
        Picture size along and across the read-out; ``across_px`` is 0 without pictures.
    loss : str
        What could not be read, in one line; empty if nothing was lost.
    warnings : list of str
        Warnings about the recording, one line each.
    """

    estimates: list[EnfEstimate] = field(default_factory=list)
    idle_by_epoch: dict[int, IdleEstimate] = field(default_factory=dict)
    results: list[MatchResult] = field(default_factory=list)
    verdicts: list[Liveness] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)
    stretches_s: list[float] = field(default_factory=list)
    row_reasons: Counter[str] = field(default_factory=Counter)
    clocks: defaultdict[int, FrameCounter] = field(
        default_factory=lambda: defaultdict(FrameCounter)
    )
    frames: int = 0
    fast_frames: int = 0
    lines: int = 0
    across_px: int = 0
    loss: str = ""
    warnings: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Seconds from first to last frame, summed over all stretches."""
        return sum(self.stretches_s)

    @property
    def frame_rate_hz(self) -> float:
        """Frame rate of the camera in Hz, over the longest stretch; NaN without a frame.

        For a stream converted to another rate it is the rate before the conversion, where the
        tracker has found it.
        """
        usable = [e for e in self.estimates if e.usable]
        found_hz = [e.frame_rate_hz for e in usable if e.converted or not self.clocks]
        if found_hz:
            return statistics.median(found_hz)
        longest = max(self.clocks.values(), key=lambda clock: clock.span_s, default=FrameCounter())
        return longest.frame_rate_hz

    @property
    def result(self) -> MatchResult:
        """Match result of the stretch with most seconds used."""
        return max(self.results, key=lambda r: r.seconds_used)

    @property
    def idle(self) -> IdleEstimate:
        """Idle estimate of the longest stretch, those with verdict ``estimated`` first.

        Without a single frame it is an empty estimate.
        """

        def tells(estimate: IdleEstimate) -> tuple[bool, int]:
            header = estimate.header
            return estimate.verdict == "estimated", header.frame_last - header.frame_first

        nothing = IdleEstimate(reason="there is no frame to go by")
        return max(self.idle_by_epoch.values(), key=tells, default=nothing)


def analyse(
    recording: Input,
    *,
    rows: RowsSettings,
    track: TrackSettings | None = None,
    idle: IdleSettings | None = None,
    make_match: Callable[[], Stage] | None = None,
    make_live: Callable[[], Stage] | None = None,
    reference: Sequence[ReferenceBlock] = (),
    progress: Callable[[float], None] = lambda seconds: None,
    tap: Tap = lambda topic, message: None,
) -> Analysis:
    """Run a recording through the rows stage, and those requested of track, idle, match and live.

    Parameters
    ----------
    recording : Input
        Yields frames, row blocks or estimates.
    rows, track, idle : RowsSettings, TrackSettings, IdleSettings
        Settings of the stages; track and idle run only if given. A recording of estimates needs no
        tracker, and allows no idle estimate.
    make_match : callable, optional
        Builds the match stage, which follows the tracker; omitted, the run ends at the estimates.
    make_live : callable, optional
        Builds the liveness stage, which reads what all other stages send.
    reference : sequence of ReferenceBlock
        Grid frequency for the match and liveness stages.
    progress : callable, optional
        Called with the number of seconds done.
    tap : callable, optional
        Called as ``tap(topic, message)`` with every message between stages.

    Raises
    ------
    InputError
        When nothing of the recording can be read.
    """
    keep_heap()
    out, begin = Analysis(), recording.begins_with
    across: dict[str, int] = {}
    stages = _stages(begin, rows, track, idle, make_match, make_live)

    def listen(topic: str, message: Any) -> None:
        if message.header.is_end:
            return
        tap(topic, message)
        match topic:
            case "rows":
                out.row_reasons[message.reason] += 1
                out.frames += message.frames
                out.fast_frames += message.frames if message.effort else 0
                if message.frames:
                    out.clocks[message.header.epoch].add(message)
                    out.lines, out.across_px = message.rows, across.get(message.read_out_axis, 0)
            case "track" if message.rank == 0:
                out.estimates.append(message)
            case "idle":
                out.idle_by_epoch[message.header.epoch] = message
            case "match":
                out.results.append(message)
            case "live":
                out.verdicts.append(message)
            case "alarm":
                out.alarms.append(message)

    pipeline = Pipeline(stages, (begin, REFERENCE), listen)

    def feed(message: Message) -> None:
        if begin != "frames":
            listen(begin, message)
        if isinstance(message, Frame) and message.width_px:
            across.update(rows=message.width_px, columns=message.height_px)
        pipeline.feed(begin, message)

    for block in reference:
        pipeline.feed(REFERENCE, block)
    pipeline.feed(REFERENCE, ReferenceBlock(header=Header(mark=Mark.END)))
    last: Message | None = None
    for message in recording.messages():
        feed(message)
        if last is None or message.header.epoch != last.header.epoch:
            first_ns, _ = _span_ns(message)
            out.stretches_s.append(0.0)
        last = message
        out.stretches_s[-1] = (_span_ns(message)[1] - first_ns) / 1e9
        progress(out.seconds)
    feed(_end_after(last, recording))
    out.loss, out.warnings = recording.loss, list(recording.warnings)
    if out.fast_frames:
        out.warnings.append(
            f"{out.fast_frames} of {out.frames} frames were decoded without the codec's loop filter"
        )
    if len(out.stretches_s) > 1:
        out.warnings.append(f"the source restarted: {len(out.stretches_s)} stretches")
    return out


def _stages(
    begin: str,
    rows: RowsSettings,
    track: TrackSettings | None,
    idle: IdleSettings | None,
    make_match: Callable[[], Stage] | None,
    make_live: Callable[[], Stage] | None,
) -> list[StageSpec]:
    """Return the stages that follow the first topic of a recording."""
    stages = [live_stage(make_live)] if make_live else []
    if begin == "frames":
        stages.append(rows_stage(rows))
    if begin != "track":
        stages += flicker_stages(track, idle)
    if make_match and (track or begin == "track"):
        stages.append(match_stage(make_match))
    return stages


def _end_after(last: Message | None, recording: Input) -> Message:
    """Return the END mark of the stream."""
    if last is None:
        kind: type[Message] = TOPICS[recording.begins_with]
        return kind(header=Header(mark=Mark.END))
    return type(last)(header=last.header.numbered(last.header.seq + 1, Mark.END))


def _span_ns(message: Message) -> tuple[int, int]:
    """Return the stream times (ns) of the start and the end of what a message covers."""
    if isinstance(message, RowBlock):
        return message.header.pts_ns, int(message.frame_pts_ns[-1])
    if isinstance(message, EnfEstimate):
        return message.start_pts_ns, message.end_pts_ns
    return message.header.pts_ns, message.header.pts_ns
