"""The whole pipeline in one process, as fast as it goes: the same stages as the nodes'."""

from __future__ import annotations

import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsenf.bus.keys import REFERENCE, TOPICS
from rsenf.flicker.frame_clock import FrameClock
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
from rsenf.run.heap import keep_heap
from rsenf.run.inputs import Input
from rsenf.run.runner import Pipeline
from rsenf.run.stages import flicker_stages, live_stage, match_stage, rows_stage
from rsenf.stage import Stage, StageSpec
from rsenf.track import TrackSettings

Message = Frame | RowBlock | EnfEstimate


Tap = Callable[[str, Any], None]


@dataclass
class Analysis:
    """What came out of a recording.

    Attributes
    ----------
    estimates : list of EnfEstimate
        Those that the tracker stands behind, in order.
    idle_by_epoch : dict of IdleEstimate
        The last of each stretch of the recording, by its epoch.
    results : list of MatchResult
        One for each stretch of the recording.
    verdicts : list of Liveness
    alarms : list of Alarm
        With their ends.
    stretches_s : list of float
        Length of each stretch; a source that restarted has several.
    row_reasons : Counter of str
        Blocks of rows by why they are of no use; those of use under ''.
    clocks : dict of FrameClock
        Over the rows of each stretch of the recording, by its epoch.
    lines, across_px : int
        Of the picture along and across the read-out; across is 0 of a recording without pictures.
    loss : str
        What could not be read, in one line; empty when all was.
    warnings : list of str
        What to say about the recording, one line each.
    """

    estimates: list[EnfEstimate] = field(default_factory=list)
    idle_by_epoch: dict[int, IdleEstimate] = field(default_factory=dict)
    results: list[MatchResult] = field(default_factory=list)
    verdicts: list[Liveness] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)
    stretches_s: list[float] = field(default_factory=list)
    row_reasons: Counter[str] = field(default_factory=Counter)
    clocks: defaultdict[int, FrameClock] = field(default_factory=lambda: defaultdict(FrameClock))
    lines: int = 0
    across_px: int = 0
    loss: str = ""
    warnings: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """From first to last frame, over all stretches."""
        return sum(self.stretches_s)

    @property
    def frame_rate_hz(self) -> float:
        """Rate at which the camera took its frames, over all of the longest stretch.

        Where the stream was converted to another rate it is the one before, as far as it was found;
        NaN without a frame.
        """
        usable = [e for e in self.estimates if e.usable]
        found_hz = [e.frame_rate_hz for e in usable if e.converted or not self.clocks]
        if found_hz:
            return statistics.median(found_hz)
        longest = max(self.clocks.values(), key=lambda clock: clock.span_s, default=FrameClock())
        return longest.frame_rate_hz

    @property
    def result(self) -> MatchResult:
        """Result of the stretch that tells most."""
        return max(self.results, key=lambda r: r.seconds_used)

    @property
    def idle(self) -> IdleEstimate:
        """Idle estimate of the stretch that tells most: the longest of those that have one.

        Of a recording without a single frame it is an empty one.
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
    """Run a recording through rows, and what is asked for of track, match and idle.

    Parameters
    ----------
    recording : Input
        Frames, row blocks or estimates.
    rows, track, idle : RowsSettings, TrackSettings, IdleSettings
        Settings of the stages; track and idle only if given. Estimates need no tracker, and tell
        nothing of the idle period.
    make_match : callable, optional
        Builds the match stage, after track; none to stop at the estimates.
    make_live : callable, optional
        Builds the judge of liveness, of what all the other stages send.
    reference : sequence of ReferenceBlock
        What the match stage and the judge compare with.
    progress : callable, optional
        Told how many seconds of the recording are done.
    tap : callable, optional
        Called with the topic and every message between stages.

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
    """Return the stages after the topic that a recording begins with."""
    stages = [live_stage(make_live)] if make_live else []
    if begin == "frames":
        stages.append(rows_stage(rows))
    if begin != "track":
        stages += flicker_stages(track, idle)
    if make_match and (track or begin == "track"):
        stages.append(match_stage(make_match))
    return stages


def _end_after(last: Message | None, recording: Input) -> Message:
    """Return the mark that ends the stream."""
    if last is None:
        kind: type[Message] = TOPICS[recording.begins_with]
        return kind(header=Header(mark=Mark.END))
    return type(last)(header=last.header.numbered(last.header.seq + 1, Mark.END))


def _span_ns(message: Message) -> tuple[int, int]:
    """Stream time at the start and at the end of what a message covers."""
    if isinstance(message, RowBlock):
        return message.header.pts_ns, int(message.frame_pts_ns[-1])
    if isinstance(message, EnfEstimate):
        return message.start_pts_ns, message.end_pts_ns
    return message.header.pts_ns, message.header.pts_ns
