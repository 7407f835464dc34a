"""The whole pipeline in one process, as fast as it goes: the same stages as the nodes'."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rsenf.messages import EnfEstimate, Frame, Header, Mark, MatchResult, RowBlock
from rsenf.rows.settings import RowsSettings
from rsenf.run.inputs import Input
from rsenf.run.runner import Chain, Runner
from rsenf.stage import Stage
from rsenf.track import TrackSettings, make_tracker


@dataclass
class Analysis:
    """What came out of a recording."""

    estimates: list[EnfEstimate] = field(default_factory=list)
    result: MatchResult | None = None
    loss: str = ""
    warnings: list[str] = field(default_factory=list)
    seconds: float = 0.0


def analyse(
    recording: Input,
    *,
    rows: RowsSettings,
    track: TrackSettings,
    make_match: Callable[[], Stage] | None = None,
    reference: list[Any] | None = None,
    progress: Callable[[float], None] = lambda seconds: None,
    tap: Callable[[str, Any], None] = lambda topic, message: None,
) -> Analysis:
    """Run a recording through rows, track and, with a reference, match.

    Parameters
    ----------
    recording : Input
        Frames or row blocks.
    rows, track : RowsSettings, TrackSettings
        Settings of the stages.
    make_match : callable, optional
        Builds the match stage; none to stop at the estimates.
    reference : list of ReferenceBlock, optional
        What the match stage compares with.
    progress : callable, optional
        Told how many seconds of the recording are done.
    tap : callable, optional
        Called with every message between stages.
    """
    out = Analysis()

    def listen(topic: str, message: Any) -> None:
        tap(topic, message)
        if isinstance(message, EnfEstimate) and not message.header.is_end:
            out.estimates.append(message)
        if isinstance(message, MatchResult) and not message.header.is_end:
            out.result = message

    runners = []
    if recording.begins_with == "frames":
        from rsenf.rows.stage import Rows

        runners.append(Runner("rows", lambda: Rows(rows)))
    runners.append(Runner("track", lambda: make_tracker(track)))
    if make_match:
        match = Runner("match", make_match, inputs=2)
        for block in reference or []:
            match.feed(block)
        match.end(Header())
        runners.append(match)
    chain = Chain(runners, listen)
    messages = recording.messages()
    head = next(messages, None)
    if head is not None:
        first_ns = head.header.pts_ns
        for message in itertools.chain([head], messages):
            if recording.begins_with == "rows":
                tap("rows", message)
            chain.feed(message)
            last = message
            out.seconds = (_end_ns(message) - first_ns) / 1e9
            progress(out.seconds)
        chain.feed(type(last)(header=last.header.numbered(last.header.seq + 1, Mark.END)))
    out.loss, out.warnings = recording.loss, recording.warnings
    return out


def _end_ns(message: Frame | RowBlock) -> int:
    if isinstance(message, RowBlock):
        return int(message.frame_pts_ns[-1])
    return message.header.pts_ns
