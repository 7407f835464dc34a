"""Which stages a recording can be asked for, made with the settings that are in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from rsenf.bus.keys import camera_key, reference_key
from rsenf.config import Graph
from rsenf.config.graph import beside_rows, outputs
from rsenf.config.model_file import load_model
from rsenf.config.node_kinds import (
    DecodeNode,
    DiscoverNode,
    IdleNode,
    LiveNode,
    MatchNode,
    Node,
    ReplayNode,
    RowsNode,
    TrackNode,
)
from rsenf.discrepancy.start import PLAIN
from rsenf.discrepancy.watch import WatchStage
from rsenf.errors import InputError, UsageError
from rsenf.idle import make_idle
from rsenf.live import Live
from rsenf.match.stage import Match
from rsenf.record import Recording
from rsenf.record.growing import ABOUT
from rsenf.regress.history import History
from rsenf.run.row_sampling import make_rows
from rsenf.run.runner import Runner
from rsenf.track import make_tracker

# In the order of the data: who is named first was wrong first.
ORDER = ("rows", "track", "idle", "match", "live", "alarm", "discover")


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
        Where its messages went.
    reads : tuple of str
        Where those that it was given came from.
    make_runner : callable
        Builds it, as it was when the recording began.
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
        When it doesn't say, or what it says isn't a graph to this program.
    """
    text = recording.metadata.get(ABOUT, {}).get("config")
    if not text:
        raise InputError(
            f"{recording.path}: doesn't say with which settings its stages ran",
            "record with a 'record' node in the graph, which writes them down",
        )
    try:
        return Graph.model_validate(yaml.safe_load(text))
    except yaml.YAMLError as exc:
        raise InputError(f"{recording.path}: its graph is not YAML") from exc
    except ValidationError as exc:
        first = exc.errors()[0]
        where = ".".join(map(str, first["loc"]))
        made_by = recording.metadata[ABOUT].get("rsenf", "unknown")
        raise InputError(
            f"{recording.path}: its graph isn't one to this program, at {where}: {first['msg']}",
            f"it was recorded by rsenf {made_by}; record it anew, or take that version",
        ) from exc


def steps_of(graph: Graph) -> list[Step]:
    """Return every stage of a graph, in the order of the data; those played are not its own."""
    found = [step for name, node in graph.nodes.items() for step in _steps(graph, name, node)]
    return sorted(found, key=lambda step: ORDER.index(step.stage))


def played(graph: Graph) -> dict[str, str]:
    """Return from which recording each topic of a stage came that was played, not made."""
    return {
        camera_key(graph.site, camera, stage): node.input
        for node in graph.of(ReplayNode)
        for stage, camera in outputs(node)
        if stage in ORDER
    }


def _steps(graph: Graph, name: str, node: Node) -> Iterator[Step]:
    site = graph.site
    if isinstance(node, ReplayNode):
        return
    for stage, camera in outputs(node):
        if stage not in ORDER:
            continue

        def key(topic: str, camera: str = camera) -> str:
            return camera_key(site, camera, topic)

        reads = {"rows": "video", "match": "track"}.get(stage, "rows")
        topics = [key(reads)]
        if isinstance(node, LiveNode):
            topics += [key(topic) for topic in beside_rows(graph, camera)]
        if isinstance(node, MatchNode | LiveNode):
            topics.append(reference_key(site, node.grid))
        yield Step(stage, name, key(stage), tuple(topics), _maker(stage, key(stage), node, topics))


def _maker(stage: str, topic: str, node: Any, reads: list[str]) -> Callable[[History], Runner]:
    def make(history: History) -> Runner:
        if isinstance(node, LiveNode):
            return Runner(
                "live", lambda: _stage(node, stage, topic, history), len(reads), beside="alarm"
            )
        return Runner(stage, lambda: _stage(node, stage, topic, history), len(reads))

    return make


def _stage(node: Node, stage: str, topic: str, history: History) -> Any:
    """Build the stage of a node as the node itself does."""
    if isinstance(node, DecodeNode | RowsNode):
        return make_rows(node.rows)
    if isinstance(node, TrackNode | IdleNode) and stage == "idle" and node.idle:
        return make_idle(node.idle)
    if isinstance(node, TrackNode):
        return make_tracker(node.track)
    if isinstance(node, MatchNode):
        return Match(
            method=node.method,
            grid=node.grid,
            interim_every_s=node.interim_every_s,
            settings=node.match,
        )
    if isinstance(node, LiveNode):
        return Live(node.live, start_utc_ns=node.start_utc_ns)
    if isinstance(node, DiscoverNode):
        pace = history.pace(topic)
        model = load_model(Path(node.model)) if node.model else PLAIN
        return WatchStage(node.discover, model, is_behind=pace.is_behind, run=pace.run)
    raise UsageError(f"a {node.kind} node has no stage")
