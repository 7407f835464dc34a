"""What a recording says of how it was made: its stages, their inputs and the versions.

Stages are built with the recorded settings. Two of their inputs are in no message: which frames of
a live camera reached the rows stage (its blocks name them), and when the discovery watch had no
time for a verdict (the next verdict counts those skipped).

Versions decide whether bits must agree. The processor counts too: NumPy and its linear algebra
choose their inner loops by its features, and another order of summation rounds differently. Of a
graph on several hosts the recording contains only the recorder's versions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TypeVar

import yaml
from pydantic import ValidationError

from rsenf.bus.keys import REFERENCE, TOPICS, topic_key, topic_of
from rsenf.config import Graph
from rsenf.config.check import compose
from rsenf.config.node_kind import NodeKind
from rsenf.errors import InputError, UsageError
from rsenf.messages import DiscoveryVerdict, Header, RowBlock
from rsenf.record import Recording
from rsenf.record.growing import ABOUT
from rsenf.record.provenance import ADDED, program_facts
from rsenf.run.runner import Runner
from rsenf.stage import StageContext, StageSpec

T = TypeVar("T")

Run = tuple[str, int]  # run and epoch


def run_of(header: Header) -> Run:
    """Return the run and epoch of a message, to which its numbers and times are relative."""
    return header.run_id, header.epoch


class RecordedContext(StageContext):
    """The environment of a stage when it was recorded: which verdicts it skipped or gave up.

    Parameters
    ----------
    skipped : list of int or None
        Number of verdicts skipped before each one; None if the stage skips none.
    stays : bool
        Whether its node had to continue after any input.

    Attributes
    ----------
    late_ns : int or None
        When the newest late input came, by the stream's clock: another order of arrival may give
        another output about then.
    """

    is_shared = False  # each stage is run alone

    def __init__(self, skipped: list[int] | None, *, stays: bool) -> None:
        self._left = None if skipped is None else list(skipped)
        self.stays = stays
        self.late_ns: int | None = None

    def late(self, pts_ns: int) -> None:
        """Note it."""
        self.late_ns = pts_ns

    def refused(self, why: str) -> None:
        """Ignore the reason: a node that stays reports it only in its state."""

    def is_behind(self) -> bool:
        """Whether the verdict that is due was skipped."""
        if not self._left or not self._left[0]:
            return False
        self._left[0] -= 1
        return True

    def run(self, work: Callable[[], T]) -> T | None:
        """Do the work, unless it was given up because the graph was stopped."""
        if self._left is None:
            return work()
        if not self._left:
            return None
        self._left.pop(0)
        return work()


@dataclass
class History:
    """What a recording contains besides its messages' content.

    Attributes
    ----------
    frames : dict
        Number of each frame that reached a rows stage, by topic, run, and time in ns.
    skipped : dict
        Number of verdicts skipped before each recorded one, by topic.
    """

    frames: dict[str, dict[Run, dict[int, int]]] = field(default_factory=dict)
    skipped: dict[str, list[int]] = field(default_factory=dict)


def history_of(recording: Recording, topics: list[str]) -> History:
    """Collect it from the row blocks and verdicts among some topics."""
    out = History()
    needed = [t for t in topics if t in recording.topics and t.endswith(("/rows", "/discover"))]
    for topic, message, _ in recording.messages(needed, tolerant=True) if needed else ():
        if message.header.is_end:
            continue
        if isinstance(message, RowBlock):
            numbers = out.frames.setdefault(topic, {}).setdefault(run_of(message.header), {})
            times = message.frame_pts_ns.tolist()
            numbers.update(zip(times, message.frame_number.tolist(), strict=True))
        elif isinstance(message, DiscoveryVerdict):
            out.skipped.setdefault(topic, []).append(message.windows_skipped)
    return out


# In the order of the data flow, so the first that differs is the cause. Others are inputs.
ORDER = [topic for topic in TOPICS if topic not in ("frames", "video", REFERENCE, "health")]
RECORDED_AS = {"frames": "video"}


@dataclass(frozen=True)
class StageRun:
    """One stage of one camera.

    Attributes
    ----------
    stage : str
        Its kind: one of :data:`ORDER`.
    node : str
        Node of the graph that it ran in.
    topic : str
        Topic of its messages.
    reads : tuple of str
        Topics of its input.
    stays : bool
        Whether its node had to continue after any input.
    make_runner : callable
        Builds it for a context, in its state at the begin of the recording.
    """

    stage: str
    node: str
    topic: str
    reads: tuple[str, ...]
    stays: bool
    make_runner: Callable[[RecordedContext], Runner]

    def context(self, history: History) -> RecordedContext:
        """Return the environment that it had."""
        return RecordedContext(history.skipped.get(self.topic), stays=self.stays)


def recorded_graph(recording: Recording) -> Graph:
    """Return the graph whose messages a recording holds.

    Raises
    ------
    InputError
        If the recording doesn't contain it, or it isn't valid in this version.
    """
    text = recording.metadata.get(ABOUT, {}).get("config")
    if not text:
        raise InputError(
            f"{recording.path}: doesn't say with which settings its stages ran",
            "record with a 'record' node in the graph, which writes them down",
        )
    try:
        compose(text)
        return Graph.model_validate(yaml.safe_load(text))
    except (yaml.YAMLError, RecursionError) as exc:
        raise InputError(f"{recording.path}: its graph is not YAML") from exc
    except ValidationError as exc:
        first = exc.errors()[0]
        where = ".".join(map(str, first["loc"]))
        if first["type"] == "union_tag_invalid":
            kind = first["ctx"]["tag"]
            raise InputError(
                f"{recording.path}: no node kind {kind!r} here, of {where}",
                f"install the package that adds it{_packages(recording)}",
            ) from exc
        made_by = recording.metadata[ABOUT].get("rsenf", "unknown")
        raise InputError(
            f"{recording.path}: its graph isn't one to this program, at {where}: {first['msg']}",
            f"it was recorded by rsenf {made_by}; record it anew, or take that version",
        ) from exc


def _packages(recording: Recording) -> str:
    """List the packages that extended rsenf where it was recorded."""
    about = recording.metadata.get(ABOUT, {})
    names = [f"{k.removeprefix(ADDED)} {v}" for k, v in about.items() if k.startswith(ADDED)]
    return f": {', '.join(names)}" if names else ""


def steps_of(graph: Graph) -> list[StageRun]:
    """Return every stage of a graph, in the order of the data flow."""
    found = [step for name, node in graph.nodes.items() for step in _steps(graph, name, node)]
    return sorted(found, key=lambda step: ORDER.index(step.stage))


def not_made(graph: Graph) -> dict[str, str]:
    """Return the topics that a graph's nodes send without a stage of rsenf, with the reasons."""
    found = {}
    for name, node in graph.nodes.items():
        why = f"it was played from {node.plays}" if node.plays else ""
        why = why or (f"the program of node {name!r} made it" if node.program() else "")
        for topic, of in node.outputs() if why else ():
            found[topic_key(graph.site, of, topic)] = why
    return found


def _steps(graph: Graph, name: str, node: NodeKind) -> Iterator[StageRun]:
    for camera in node.feeds:
        for number, stage in enumerate(node.stages()):
            streams = graph.reads_of(node, stage, camera)
            reads = [
                topic_key(graph.site, of, RECORDED_AS.get(topic, topic)) for topic, of in streams
            ]
            for topic in filter(ORDER.__contains__, stage.sends):
                key = topic_key(graph.site, camera, topic)
                stays = graph.restart_of(name) is not None
                make = _maker(node, number, key, len(reads))
                yield StageRun(topic, name, key, tuple(reads), stays, make)


def _maker(
    node: NodeKind, number: int, key: str, inputs: int
) -> Callable[[RecordedContext], Runner]:
    def make(context: RecordedContext) -> Runner:
        stage: StageSpec = node.stages(context)[number]
        try:
            return Runner.of(stage, inputs)
        except UsageError as exc:
            raise InputError(f"{key}: {exc.message}", exc.hint) from exc

    return make


BESIDE = ("created_utc", "host", "platform")  # where and when it was recorded
# These libraries only carry messages.
_CARRIERS = ("eclipse-zenoh", "mcap", "protobuf", "zstandard")
_NO_MATTER = {*BESIDE, *(f"library {name}" for name in _CARRIERS)}


def changed_since(recording: Recording) -> dict[str, tuple[str, str]]:
    """Return what changed since a recording was made: then and now, by name."""
    then, now = recording.metadata.get(ABOUT, {}), program_facts()
    changed = {
        name: (then.get(name, "unknown"), value)
        for name, value in now.items()
        if name not in _NO_MATTER and then.get(name) != value
        if name in then or not name.startswith(ADDED)  # packages added since made none of it
    }
    gone = [name for name in then if name.startswith(ADDED) and name not in now]
    changed |= {name: (then[name], "not installed") for name in gone}
    if (hosts := _hosts(recording)) - {then.get("host")}:
        changed["host"] = (", ".join(sorted(hosts)), now["host"])
    return changed


def _hosts(recording: Recording) -> set[str]:
    """Hosts of a recording's nodes, from their health messages."""
    topics = [name for name in recording.topics if topic_of(name) == "health"]
    words = recording.messages(topics, tolerant=True) if topics else ()
    return {word.host for _, word, _ in words if word.host}
