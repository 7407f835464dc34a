"""Records the outputs of a recording's stages again, with the reason why they may have changed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

from rsenf.errors import InputError
from rsenf.messages import Header, Health, ReferenceBlock, VideoPacket
from rsenf.record import Recorder, Recording, open_recording
from rsenf.record.growing import ABOUT, CLOSING
from rsenf.record.provenance import ADDED, program_facts
from rsenf.regress.plan import (
    BESIDE,
    History,
    StageRun,
    changed_since,
    history_of,
    recorded_graph,
    steps_of,
)
from rsenf.regress.rerun import Pictures, runnable
from rsenf.regress.verdict import Regression
from rsenf.run.runner import Runner
from rsenf.whole_file import whole_file

ACCEPTED = "rsenf.accepted."


def accept(result: Regression, reason: str) -> None:
    """Record the outputs of a recording again, in its place.

    What came from outside is kept: video, references, and everything that no stage produces. Each
    stage gets the new output of the stage before it. The reason, what changed, and the previous
    versions are written to a metadata record ``rsenf.accepted.N``, which later records keep.

    Parameters
    ----------
    result : Regression
    reason : str

    Raises
    ------
    InputError
        If the recording or its video is incomplete, so that not all outputs can be produced again.
    RecordingError
        If it can't be written; the recording is then unchanged.
    """
    recording = open_recording(result.recording)
    if not result.whole:
        why = result.loss or next(t.unjudged for t in result.topics if t.unjudged)
        raise InputError(f"{recording.path}: not whole, and can't be recorded anew: {why}")
    if any(topic.stage == "decode" for topic in result.topics):
        raise InputError(f"{recording.path}: its video lacks frames, which would be lost for good")
    if foreign := [name for name, topic in recording.topics.items() if not topic.is_ours]:
        raise InputError(f"{recording.path}: {', '.join(foreign)} of others would be lost")
    steps, _ = runnable(recording)
    accepted_utc = datetime.now(UTC).isoformat(timespec="seconds")
    note = {"reason": reason, "accepted_utc": accepted_utc}
    before = {f"before {name}": then for name, (then, _) in changed_since(recording).items()}
    _record_anew(recording, steps, {**note, **_moved(result), **before})


def complete(path: Path) -> None:
    """Run every stage of the graph of a recording that holds only their inputs.

    The same recording gives the same file, byte for byte, on the same versions.
    """
    recording = open_recording(path)
    _record_anew(recording, steps_of(recorded_graph(recording)), {})


def _record_anew(recording: Recording, steps: list[StageRun], note: dict[str, str]) -> None:
    """Replace a recording by one with the present outputs of some stages."""
    about = recording.metadata[ABOUT]
    now = program_facts()
    kept = {k: v for k, v in about.items() if k in BESIDE or not (k in now or k.startswith(ADDED))}
    clock = _Clock(recording)
    with (
        whole_file(recording.path) as part,
        Recorder(part, run_info=kept, clock_ns=clock.now_ns) as recorder,
    ):
        for name, values in recording.metadata.items():
            if name not in (ABOUT, CLOSING):
                recorder.add_metadata(name, values)
        if note:
            number = 1 + sum(name.startswith(ACCEPTED) for name in recording.metadata)
            recorder.add_metadata(f"{ACCEPTED}{number}", note)
        chain = _Chain(steps, history_of(recording, [step.topic for step in steps]))
        for topic, message, log_time_ns in recording.messages():
            clock.move(message, log_time_ns)
            for sent_to, sent in chain.feed(topic, message):
                recorder.write(sent_to, sent)
        for sent_to, sent in chain.finish():
            recorder.write(sent_to, sent)


class _Clock:
    """Recording time of messages without stream time, so that they keep their place."""

    def __init__(self, recording: Recording) -> None:
        self._now_ns = min(topic.first_ns for topic in recording.topics.values())

    def now_ns(self) -> int:
        return self._now_ns

    def move(self, message: Any, log_time_ns: int) -> None:
        if isinstance(message, Health | ReferenceBlock):
            self._now_ns = max(self._now_ns, log_time_ns)


class _Lane(NamedTuple):
    """A running stage."""

    step: StageRun
    runner: Runner
    pictures: Pictures


class _Chain:
    """The stages in sequence, fed with what came from outside."""

    def __init__(self, steps: list[StageRun], history: History) -> None:
        self._lanes = [
            _Lane(
                step,
                step.make_runner(step.context(history)),
                Pictures(history.frames.get(step.topic)),
            )
            for step in steps
        ]
        self._made = {step.topic for step in steps}
        self._ends: dict[str, Header] = {}  # END marks of the recorded outputs

    def feed(self, topic: str, message: Any) -> Iterator[tuple[str, Any]]:
        """Yield a recorded message and all that follows from it; nothing for one produced again."""
        if topic not in self._made:
            yield from self._passed_on(topic, message)
        elif message.header.is_end:
            self._ends[topic] = message.header

    def finish(self) -> Iterator[tuple[str, Any]]:
        """Yield what stages send at their end, if their sender was lost and sent no END mark."""
        for lane in self._lanes:
            yield from self._fed(lane, lane.pictures.rest())
            while not lane.runner.ended:
                header = self._ends.get(lane.step.topic, Header())
                yield from self._sent(lane, lane.runner.end(header))

    def _passed_on(self, topic: str, message: Any) -> Iterator[tuple[str, Any]]:
        yield topic, message
        for lane in self._lanes:
            if topic in lane.step.reads:
                is_packet = isinstance(message, VideoPacket)
                yield from self._fed(lane, lane.pictures.feed(message) if is_packet else [message])

    def _fed(self, lane: _Lane, inputs: Iterable[Any]) -> Iterator[tuple[str, Any]]:
        for one in inputs:
            yield from self._sent(lane, lane.runner.feed(one))

    def _sent(self, lane: _Lane, messages: list[Any]) -> Iterator[tuple[str, Any]]:
        for message in messages:
            yield from self._passed_on(lane.step.topic, message)


def _moved(result: Regression) -> dict[str, str]:
    """Describe what changed, topic by topic."""
    return {
        f"moved {t.topic}": f"{t.differing} of {t.messages} messages, by {t.max_abs_diff:.6g}"
        for t in result.topics
        if not t.passed
    }
