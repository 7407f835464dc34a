"""The main loop of nodes with a stage: receive, feed the stage, send.

A :class:`Lane` is one camera's path through the node. One that samples frames takes their pixels
from the shared-memory ring, and returns them.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from threading import Thread
from typing import Any, TypeVar

from rsenf.bus.bus import Publisher
from rsenf.bus.frames import FrameReceiver
from rsenf.bus.inbox import Received
from rsenf.bus.keys import ROWS, TOPICS, camera_key, source_of, topic_key, topic_of
from rsenf.config.graph import source_waits
from rsenf.errors import NodeFailed, SchemaMismatch
from rsenf.messages import Frame, Header, Mark
from rsenf.run.node import NodeProcess
from rsenf.run.runner import Branches, Runner
from rsenf.stage import StageContext, StageSpec

T = TypeVar("T")

# An input whose sender has gone without an END mark is closed after this long without a message.
GIVE_UP_S = 1.0
# A sender that ended with 'done' has sent its END mark: it may still be queued for a slow reader.
UNDER_WAY_S = 60.0
# Told to stop, a node still takes queued messages, but no longer than this.
LINGER_S = 0.4
POLL_S = 0.1
# Extra time for a camera and its readers to start before silence is reported.
FIRST_PICTURE_S = 25.0
# Queued row blocks of a live camera beyond which optional work is skipped. At twice as many,
# backpressure would stop the camera, and with it all its other readers.
BEHIND = ROWS.queue // 2


@dataclass
class Watch:
    """The input whose silence a stage is told of.

    Parameters
    ----------
    key : str
    stage : StageSpec
        Has the time limit, to which ``FIRST_PICTURE_S`` is added before the first message.
    runner : Runner
        Runner of the stage.
    is_behind : callable
        Whether messages wait in the sender, which is then not silent.
    """

    key: str
    stage: StageSpec
    runner: Runner
    is_behind: Callable[[], bool]


@dataclass(kw_only=True)
class Lane:
    """One camera's path through a node: its inputs, stages and outputs.

    Parameters
    ----------
    node : NodeProcess
    runner : Runner or Branches
        Runs the stage or stages.
    publishers : dict
        Output for each message class.
    inputs : dict
        Sending node ('' if unknown) by key, of each input that hasn't ended.
    shown : tuple of type
        Message classes whose newest ``in_short`` is shown in the node's health.
    ahead : bool
        Whether input comes faster than real time, so that outputs may be batched.
    watch : Watch, optional
        The input whose silence is reported.
    frames : FrameReceiver, optional
        Gives frames their pixels.
    """

    node: NodeProcess
    runner: Runner | Branches
    publishers: dict[type[Any], Publisher]
    inputs: dict[str, str]
    shown: tuple[type[Any], ...] = ()
    ahead: bool = False
    watch: Watch | None = None
    frames: FrameReceiver | None = None
    _heard: dict[str, float] = field(default_factory=dict)
    _begun: set[str] = field(default_factory=set)

    def feed(self, received: Received) -> None:
        """Feed a message to the stage and send what it completes.

        Raises
        ------
        SchemaMismatch
            When it can't follow those before it, or a frame's pixels don't match its description.
        """
        if self.frames is None:
            self._take(received.key, received.message)
            return
        frame = self._with_pixels(self.frames, received.message)
        if frame is None:
            self.node.inbox.counters.dropped += 1
            return
        try:
            self._take(received.key, frame)
        finally:
            self.frames.done()

    def _with_pixels(self, frames: FrameReceiver, frame: Frame) -> Frame | None:
        try:
            return frames.open(frame)
        except NodeFailed as exc:  # no such ring on this host: a failure only for one of this run
            if frame.header.run_id.partition(".")[0] == self.node.run_id:
                raise
            raise SchemaMismatch(str(exc)) from exc

    def _take(self, key: str, message: Any) -> None:
        if key not in self.inputs:
            return
        if message.header.is_end:
            del self.inputs[key]
        self.send(self.runner.feed(message))
        # Taken after the stage's work, which must not count as the sender's silence.
        self._heard[key] = time.monotonic()
        self._begun.add(key)

    def give_up(self) -> None:
        """Report silence, and end the inputs of senders that are gone without more to come."""
        now, peers = time.monotonic(), self.node.peers
        if self.watch and self.watch.key in self.inputs:
            self._report_silence(self.watch, now)
        for key, sender in list(self.inputs.items()):
            ends = key in self._begun and peers.has_finished(sender)
            patience_s = UNDER_WAY_S if ends else GIVE_UP_S
            silent_s = now - self._heard.setdefault(key, now)
            if min(silent_s, peers.gone_for_s(sender)) > patience_s:
                if self.node.restarts and key not in self._begun:
                    self.node.note_cut_off(key)
                self._end(key)

    def _report_silence(self, watch: Watch, now: float) -> None:
        more_s = 0.0 if watch.key in self._begun else FIRST_PICTURE_S
        if now - self._heard.get(watch.key, now) <= watch.stage.silent_s + more_s:
            return
        if watch.is_behind():  # what waits may take a moment to come
            self._heard[watch.key] = now
        elif watch.stage.on_silence:
            self.send(watch.runner.feed(watch.stage.on_silence(self._header())))

    def end(self) -> None:
        """End all inputs that are still open."""
        for key in list(self.inputs):
            self._end(key)

    def _end(self, key: str) -> None:
        del self.inputs[key]
        header = self._header(Mark.END)
        self.send(self.runner.feed(TOPICS[topic_of(key)](header=header)))

    def _header(self, mark: Mark = Mark.DATA) -> Header:
        """Return the header of a stream that may never have begun."""
        source = source_of(next(iter(self.publishers.values())).key)
        return Header(run_id=self.node.run_id, source=source, mark=mark)

    def send(self, messages: Iterable[Any]) -> None:
        """Send messages of the stage, and show the newest in the node's health."""
        for message in messages:
            is_end = message.header.is_end
            publisher = self.publishers.get(type(message))
            if publisher is None:
                what = f"{type(self.node.config).__name__} sends {type(message).__name__}"
                raise NodeFailed(f"{what} undeclared", "name its topic in StageSpec.sends")
            publisher.send(message, more=self.ahead and not is_end)
            if isinstance(message, self.shown) and not is_end:
                self.node.show_newest(source_of(publisher.key).split("/")[1], message.in_short)


def lane_of(
    node: NodeProcess,
    camera: str,
    stages: Sequence[StageSpec],
    frames: FrameReceiver | None = None,
    *,
    ahead: bool = False,
) -> Lane:
    """Open the inputs and outputs of a camera's stages.

    Parameters
    ----------
    node : NodeProcess
    camera : str
    stages : sequence of StageSpec
        Each is fed the topics that it reads.
    frames, ahead
        As for :class:`Lane`.
    """
    site, inputs = node.graph.site, dict[str, str]()
    branches: list[tuple[Sequence[str], Runner]] = []
    watch: Watch | None = None
    for stage in stages:
        reads = node.graph.reads_of(node.config, stage, camera)
        for stream in reads:
            key = topic_key(site, stream.of, stream.topic)
            if key not in inputs:
                inputs[node.subscribe(key)] = node.sender_of(*stream)
        runner = Runner.of(stage, len(reads))
        branches.append(([stream.topic for stream in reads], runner))
        if stage.on_silence and math.isfinite(stage.silent_s):
            key = camera_key(site, camera, stage.reads[0])
            behind = node.backlog_of(inputs[key]) if inputs[key] else lambda: False
            watch = Watch(key, stage, runner, behind)
    return Lane(
        node=node,
        runner=Branches(*branches),
        publishers={TOPICS[t]: node.publisher(camera, t) for s in stages for t in s.sends},
        inputs=inputs,
        shown=tuple(TOPICS[stage.shown] for stage in stages if stage.shown),
        ahead=ahead,
        watch=watch,
        frames=frames,
    )


class NodeContext(StageContext):
    """Context of a stage in a node process.

    Parameters
    ----------
    node : NodeProcess
    camera : str
        Camera of the stage.
    """

    def __init__(self, node: NodeProcess, camera: str) -> None:
        self._node = node
        self.stays = node.graph.restart_of(node.name) is not None
        self._waits = source_waits(node.graph, camera)

    def refused(self, why: str) -> None:
        """Count a refused input, and say why in the node's health."""
        self._node.inbox.counters.rejected += 1
        self._node.say("running", f"not compared: {why}")

    def is_behind(self) -> bool:
        """Whether so much waits that backpressure would soon stop a live camera."""
        return not self._waits and self._node.inbox.depth > BEHIND

    def run(self, work: Callable[[], T]) -> T | None:
        """Do the work in a thread; abandon it (None) when the node is told to stop."""
        done: Future[T] = Future()

        def do() -> None:
            try:
                done.set_result(work())
            except Exception as exc:  # noqa: BLE001 - raised again by done.result
                done.set_exception(exc)

        Thread(target=do, name="stage", daemon=True).start()
        while not self._node.stop.is_set():
            with contextlib.suppress(TimeoutError):
                return done.result(POLL_S)
        return None


def pump(node: NodeProcess, lanes: list[Lane]) -> None:
    """Run until every lane has ended, or the node is told to stop.

    A node told to stop takes what has already arrived, flushes its stages and sends END marks, so
    that the nodes after it finish too.
    """
    by_key: dict[str, list[Lane]] = {}
    for lane in lanes:
        for key in lane.inputs:
            by_key.setdefault(key, []).append(lane)
    looked, stop_by = 0.0, float("inf")
    while any(lane.inputs for lane in lanes):
        received = node.inbox.receive(POLL_S)
        if received is not None:
            node.note_input(received.message.header)
            for lane in by_key.get(received.key, ()):
                try:
                    lane.feed(received)
                except SchemaMismatch:
                    node.inbox.counters.rejected += 1
        now = time.monotonic()
        if node.stop.is_set():
            stop_by = min(stop_by, now + LINGER_S)
            if received is None or now > stop_by:
                break
        if now - looked > POLL_S and not node.inbox.depth:
            looked = now
            for lane in lanes:
                lane.give_up()
    for lane in lanes:
        lane.end()
