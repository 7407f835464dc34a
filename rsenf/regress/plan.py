"""Lists the stages of a recording that can be run again, with its recorded settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import yaml
from pydantic import ValidationError

from rsenf.bus.keys import REFERENCE, TOPICS, topic_key
from rsenf.config import Graph
from rsenf.config.check import compose
from rsenf.config.node_kind import NodeKind
from rsenf.errors import InputError, UsageError
from rsenf.record import Recording
from rsenf.record.growing import ABOUT
from rsenf.record.provenance import ADDED
from rsenf.regress.history import History
from rsenf.run.runner import Runner
from rsenf.stage import StageSpec

# In the order of the data flow, so the first that differs is the cause. Others are inputs.
ORDER = [topic for topic in TOPICS if topic not in ("frames", "video", REFERENCE, "health")]
RECORDED_AS = {"frames": "video"}


@dataclass(frozen=True)
class Step:
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
    make_runner : callable
        Builds it, in its state at the begin of the recording.
    """

    stage: str
    node: str
    topic: str
    reads: tuple[str, ...]
    make_runner: Callable[[History], Runner]


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


def steps_of(graph: Graph) -> list[Step]:
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


def _steps(graph: Graph, name: str, node: NodeKind) -> Iterator[Step]:
    for camera in node.feeds:
        for number, stage in enumerate(node.stages()):
            streams = graph.reads_of(node, stage, camera)
            reads = [
                topic_key(graph.site, of, RECORDED_AS.get(topic, topic)) for topic, of in streams
            ]
            for topic in filter(ORDER.__contains__, stage.sends):
                key = topic_key(graph.site, camera, topic)
                stays = graph.restart_of(name) is not None
                make = _maker(node, number, key, len(reads), stays=stays)
                yield Step(topic, name, key, tuple(reads), make)


def _maker(
    node: NodeKind, number: int, key: str, inputs: int, *, stays: bool
) -> Callable[[History], Runner]:
    def make(history: History) -> Runner:
        stage: StageSpec = node.stages(history.context(key, stays=stays))[number]
        try:
            return Runner.of(stage, inputs)
        except UsageError as exc:
            raise InputError(f"{key}: {exc.message}", exc.hint) from exc

    return make
