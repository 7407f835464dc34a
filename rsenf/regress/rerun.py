"""Runs every stage on its recorded input and compares with its recorded output.

The rows stage gets the frames of the recorded video, decoded again.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import av

from rsenf.bus.keys import ROOT, TOPICS, matches, topic_of
from rsenf.config import Graph
from rsenf.decode.packets import PacketDecoder, TaggedPicture
from rsenf.decode.stream import luma_plane
from rsenf.errors import InputError, SchemaMismatch
from rsenf.messages import Frame, Header, RowBlock, VideoPacket
from rsenf.record import Recording, open_recording
from rsenf.regress.plan import (
    ORDER,
    History,
    Run,
    StageRun,
    changed_since,
    history_of,
    not_made,
    recorded_graph,
    run_of,
    steps_of,
)
from rsenf.regress.tolerance import moved
from rsenf.regress.verdict import Regression, TopicVerdict
from rsenf.timebase import NS_PER_S

ABOUT_LATE_NS = 60 * NS_PER_S  # from a late input, within which the order of inputs matters
LATE = "an input came late, and it isn't recorded before which others its stage got it"


class Pictures:
    """Decodes the packets of one camera.

    The pictures are bit-identical to those of the recording, since the codecs' standards define
    decoding exactly. Each is identified by its presentation time.

    Parameters
    ----------
    numbers : dict, optional
        Numbers of the frames that reached the rows stage, by run and time in ns. Other pictures are
        dropped. If None, all are kept and numbered from 0.

    Attributes
    ----------
    yielded : int
        Number of frames yielded.
    mistimed : bool
        Whether the video's times are not the presentation times of its pictures.
    """

    def __init__(self, numbers: dict[Run, dict[int, int]] | None) -> None:
        self._numbers = numbers
        self._run: Run | None = None
        self._decoder: PacketDecoder | None = None
        self._count = 0
        self.yielded = 0
        self.mistimed = False

    @property
    def missing(self) -> int:
        """Number of frames that the rows stage got and the video lacks."""
        wanted = sum(map(len, self._numbers.values())) if self._numbers else self.yielded
        return wanted - self.yielded

    def feed(self, packet: VideoPacket) -> Iterator[Frame]:
        """Yield the frames that a packet completes, and the END mark after the last."""
        if packet.header.is_end:
            yield from self.rest()
            yield Frame(header=packet.header)
            return
        if run_of(packet.header) != self._run:
            yield from self.rest()
            self._run, self._count = run_of(packet.header), 0
            self._decoder = PacketDecoder(packet.codec)
        assert self._decoder is not None
        pts_ns = None if packet.untimed else packet.header.pts_ns
        try:
            decoded = self._decoder.decode(packet.data, packet.header, pts_ns=pts_ns)
        except av.FFmpegError:
            return  # damaged when recorded, too: the decode node dropped it
        yield from self._frames(self._decoder, decoded)

    def rest(self) -> Iterator[Frame]:
        """Yield the frames left in the decoder: after a lost sender there is no END mark."""
        if self._decoder is not None:
            with contextlib.suppress(av.FFmpegError):
                yield from self._frames(self._decoder, self._decoder.rest())
            self._decoder = None

    def _frames(self, decoder: PacketDecoder, decoded: list[TaggedPicture]) -> Iterator[Frame]:
        self.mistimed |= decoder.contradicts
        for one in decoded:
            yield from self._frame(one)

    def _frame(self, decoded: TaggedPicture) -> Iterator[Frame]:
        picture, header = decoded
        number, self._count = self._count, self._count + 1
        if self._numbers is not None:
            number = self._numbers.get(run_of(header), {}).get(header.pts_ns, -1)
        if number < 0 or picture.is_corrupt:
            return
        self.yielded += 1
        yield Frame(
            header=dataclasses.replace(header, seq=number, frame_first=number, frame_last=number),
            height_px=picture.height,
            width_px=picture.width,
            keyframe=picture.key_frame,
            luma=luma_plane(picture),
        )


def regress(path: str | Path) -> Regression:
    """Run every stage of a recording again, and compare.

    Each stage gets the recorded input, not the new output of the stages before it, so each stage
    that differs has changed itself.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    UsageError
        If there is no such file.
    InputError
        If it can't be read, doesn't contain its graph, or has no stage that can be run again.
    """
    recording = open_recording(path)
    steps, left_out = runnable(recording)
    if not steps:
        why = "; ".join(f"{t}: {reason}" for t, reason in left_out.items())
        raise InputError(f"{path}: no stage can be run again", why or "it holds no stage's output")
    changed = changed_since(recording)
    history = history_of(recording, [step.topic for step in steps])
    try:
        runs = [StepRun(step, history, exact=not changed) for step in steps]
    except InputError as exc:
        raise InputError(f"{path}: {exc.message}", exc.hint) from exc
    topics = {step.topic for step in steps}.union(*(step.reads for step in steps))
    for topic, message, log_time_ns in recording.messages(topics, tolerant=True):
        for run in runs:
            run.take(topic, message, log_time_ns)
    verdicts = [run.finish() for run in runs]
    return Regression(str(path), changed, verdicts, left_out, recording.lost)


def runnable(recording: Recording) -> tuple[list[StageRun], dict[str, str]]:
    """Return the steps with recorded input and output, and the reasons why others can't be run."""
    graph = recorded_graph(recording)
    all_steps = steps_of(graph)
    why = dict.fromkeys(recording.topics, "no node of its graph is said to send it")
    why |= not_made(graph)
    made = {step.topic for step in all_steps}
    left_out = {
        name: why[name]
        for name, topic in recording.topics.items()
        if topic.is_ours and topic_of(name) in ORDER and name not in made
    }
    steps = []
    for step in all_steps:
        if step.topic not in recording.topics:
            if _was_recorded(graph, step.topic):
                left_out[step.topic] = "nothing of it is in the recording"
            continue
        absent = [topic for topic in step.reads if topic not in recording.topics]
        if absent:
            left_out[step.topic] = f"{' and '.join(absent)} was not recorded"
        else:
            steps.append(step)
    return steps, left_out


def _was_recorded(graph: Graph, topic: str) -> bool:
    """Whether a graph's recorder subscribed to a topic."""
    return any(
        matches(f"{ROOT}/{graph.site}/{below}", topic)
        for node in graph.nodes.values()
        for below in node.records
    )


class GapDetector:
    """Detects gaps in the sequence numbers of some topics."""

    def __init__(self) -> None:
        self._due: dict[tuple[str, Run], int] = {}

    def gap(self, topic: str, header: Header) -> str:
        """Return which messages are missing before this one; empty for none."""
        stream = topic, run_of(header)
        due, self._due[stream] = self._due.get(stream, 0), header.seq + 1
        return f"{topic} lacks messages {due} to {header.seq - 1}" if header.seq > due else ""


class StepRun:
    """A running stage: fed with its recorded input, its output compared with the recorded one.

    Parameters
    ----------
    step : StageRun
    history : History
        What the stage got besides messages.
    exact : bool
        Whether every bit counts.
    """

    def __init__(self, step: StageRun, history: History, *, exact: bool) -> None:
        self._step, self._exact = step, exact
        self._context = step.context(history)
        self._runner = step.make_runner(self._context)
        self._pictures = Pictures(history.frames.get(step.topic, {}))
        self._verdict = TopicVerdict(step.topic, step.stage)
        # Each with its log time, and what is missing in the recording before it.
        self._recorded: deque[tuple[Any, int, str]] = deque()
        self._again: deque[Any] = deque()
        self._numbers = GapDetector()
        self._unrecorded = 0
        self._blind = False
        self._ended: Header | None = None  # its recorded END mark

    def take(self, topic: str, message: Any, log_time_ns: int) -> None:
        """Take a message of the recording: as input, as expected output, or neither."""
        if self._blind:
            return
        if topic == self._step.topic:
            lacks = self._numbers.gap(topic, message.header)
            self._recorded.append((message, log_time_ns, lacks))
            if message.header.is_end:
                self._ended = message.header
        elif topic in self._step.reads and not self._verdict.unjudged:
            self._verdict.unjudged = self._numbers.gap(topic, message.header)
            if not self._verdict.unjudged:
                is_video = isinstance(message, VideoPacket)
                self._feed(self._pictures.feed(message) if is_video else (message,))
        self._compare()

    def finish(self) -> TopicVerdict:
        """Return the result."""
        if self._ended and not self._verdict.unjudged:
            # After a lost sender a stage ends without an END mark of its input.
            self._feed(self._pictures.rest())
        verdict = self._verdict
        if self._pictures.missing and not self._pictures.yielded:
            verdict.unjudged = "its video was not recorded"
        if self._ended and not verdict.unjudged:
            while not self._runner.ended:
                self._add(self._runner.end(self._ended))
            self._compare()
            unpaired = [*(then for then, _, _ in self._recorded), *self._again]
            if unpaired and self._is_about_late(unpaired[0].header):
                verdict.unjudged = LATE
                return verdict
            for message, log_time_ns, _ in self._recorded:
                verdict.lack(message.header, log_time_ns)
            for message in self._again:
                verdict.add(message.header)
        elif not verdict.unjudged:
            verdict.unjudged = "the recording ends before this stage did"
        if self._unrecorded and not verdict.unjudged:
            verdict.unjudged = f"{self._unrecorded} of its messages were not recorded"
        if self._pictures.missing and not verdict.passed:
            verdict.stage = "decode"
        return verdict

    def _feed(self, inputs: Iterable[Any]) -> None:
        for one in inputs:
            with contextlib.suppress(SchemaMismatch):  # a node skips such a message, too
                self._add(self._runner.feed(one))
        if self._pictures.mistimed and not self._blind:
            why = "an older version of rsenf recorded its video without the times of its pictures"
            self._verdict = TopicVerdict(self._step.topic, self._step.stage, unjudged=why)
            self._blind = True

    def _add(self, messages: Iterable[Any]) -> None:
        """Keep the messages of its topic: a stage may send to another one too."""
        kind = TOPICS[topic_of(self._step.topic)]
        self._again += [message for message in messages if isinstance(message, kind)]

    def _compare(self) -> None:
        while self._recorded and self._again and not self._blind:
            then, log_time_ns, lacks = self._recorded[0]
            if lacks and self._step.stage == "rows":
                # Only its recorded blocks say which frames the stage got.
                self._verdict.unjudged, self._blind = lacks, True
                return
            if isinstance(then, RowBlock) and then.effort:
                why = "it was decoded without the loop filter, and is decoded in full again"
                self._verdict.unjudged, self._blind = why, True
                return
            now = self._again.popleft()
            same = run_of(now.header) == run_of(then.header)
            if lacks and same and now.header.seq < then.header.seq:
                self._unrecorded += 1
                continue
            self._recorded.popleft()
            differs = moved(then, now, exact=self._exact)
            if differs and self._is_about_late(then.header):
                self._verdict.unjudged, self._blind = LATE, True
                return
            self._verdict.take(then.header, differs, log_time_ns)

    def _is_about_late(self, header: Header) -> bool:
        """Whether a message is of about when an input came late."""
        late_ns = self._context.late_ns
        return late_ns is not None and abs(header.pts_ns - late_ns) < ABOUT_LATE_NS
