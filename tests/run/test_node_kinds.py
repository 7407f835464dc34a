"""Every kind of node, whoever added it: what it declares, its contract, its settings run again."""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import Film
from kind_settings import FIXED, VARIANTS, untried
from live_run import LiveRun

from rsenf.bus.keys import TOPICS
from rsenf.config import Graph, load_graph
from rsenf.config.node_kind import NODE_KINDS, NodeKind
from rsenf.errors import EXIT_DONE
from rsenf.record import open_recording
from rsenf.regress import regress
from rsenf.run.own_node import NODE, SITE, check_contract
from rsenf.run.process import wait_until

MODEL = "version: 2\nlight: {lamp: led}\nshutter: {rows: 32, columns: 64, idle_ratio: 0.3}\n"
# A kind's place in a graph: where its input comes from, which is read by whom.
PLACES: dict[str, dict[str, Any]] = {
    "decode": {"camera": "cam", "input": "FILM", "pace": True},
    "replay": {"input": "RECORDING", "topics": ["cam/rows"], "rename": {"cam": "other"}},
    "reference": {"grid": "ce", "input": "GRID"},
    "record": {"out": "OUT"},
    "match": {"grid": "ce"},
    "live": {"grid": "ce"},
    "external": {"command": ["true"], "reads": ["cam/track"], "sends": ["cam/alarm"]},
}


def placed(kind: str, variant: dict[str, Any], cameras: tuple[str, ...] = ("cam",)) -> Any:
    """Settings of a node as a graph file has them."""
    served = {"cameras": list(cameras)} if "cameras" in NODE_KINDS[kind].model_fields else {}
    return {"kind": kind, **served, **PLACES.get(kind, {}), **variant}


@pytest.mark.parametrize("kind", NODE_KINDS)
def test_no_field_is_left_out_of_these_tests(kind: str) -> None:
    """A new one is run again by regress, in another setting than its default, or this fails."""
    assert untried(NODE_KINDS[kind], VARIANTS[kind]) == set(FIXED.get(kind, {}))


@pytest.mark.parametrize("kind", NODE_KINDS)
def test_what_a_kind_declares_holds_together(kind: str) -> None:
    for variant in VARIANTS[kind]:
        nodes = {"node": placed(kind, variant, ("one", "two"))}
        node = Graph.model_validate({"version": 1, "site": "lab", "nodes": nodes}).nodes["node"]
        sent = node.outputs()
        assert {topic for topic, _ in sent} <= set(TOPICS)
        assert len(set(sent)) == len(sent)
        assert not {read.stream for read in node.inputs()} & set(sent)
        assert all(read.where in type(node).model_fields for read in node.inputs())
        assert node.named_by in type(node).model_fields or not sent
        made = {topic for stage in node.stages() for topic in stage.sends}
        assert made <= {topic for topic, _ in sent}
        for stage in node.stages():
            assert {*stage.optional} <= {*stage.reads}
            assert stage.shown in ("", *stage.sends)
            assert set(stage.reads) <= set(TOPICS)
        assert type(node).__doc__
        assert bool(node.program()) != (type(node).body is not NodeKind.body)


def files(folder: Path, film: Film) -> dict[str, str]:
    """What the settings name."""
    model, graph = folder / "model.yaml", folder / "simulated.yaml"
    model.write_text(MODEL, encoding="utf-8")
    growing, begin = folder / "growing.csv", datetime(2026, 1, 2, 3, tzinfo=UTC)
    lines = [line.split(",") for line in film.reference.read_text().splitlines()[1:]]
    told = [f"{(begin + timedelta(seconds=float(s))).isoformat()},{hz}" for s, hz in lines]
    growing.write_text("\n".join(["time,frequency", *told, ""]), encoding="utf-8")
    names = {"FILM": film.video, "GRID": growing, "MODEL": model, "OUT": folder / "out.mcap"}
    names |= {"RECORDING": folder / "rows.mcap", "STORE": folder / "store", "GRAPH": graph}
    names["QUEUE"] = folder / "queue.sqlite"
    return {name: str(path) for name, path in names.items()}


def with_files(settings: Any, names: dict[str, str]) -> Any:
    """Settings with files in the place of their names."""
    text = json.dumps(settings)
    for name, path in names.items():
        text = text.replace(f'"{name}"', json.dumps(path))
    return json.loads(text)


def write(path: Path, nodes: dict[str, Any], **more: Any) -> Path:
    path.write_text(
        yaml.safe_dump({"version": 1, "site": "lab", **more, "nodes": nodes}), encoding="utf-8"
    )
    return path


@pytest.fixture(scope="module")
def named(film: Film, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The files, with a recording to play."""
    from rsenf.cli import main

    names = files(tmp_path_factory.mktemp("kinds"), film)
    words = ["simulate", "--out", names["RECORDING"], "--duration-s", "12", "--camera", "cam"]
    assert main([*words, "--site", "lab", "--model", names["MODEL"]]) == EXIT_DONE
    return names


@pytest.mark.processes
@pytest.mark.parametrize("kind", [k for k in NODE_KINDS if k != "external"])
def test_a_kind_keeps_the_contract(kind: str, named: dict[str, str], tmp_path: Path) -> None:
    """Started by hand on a bus of others: its token, its health, bad messages, a clean stop."""
    settings = placed(kind, VARIANTS[kind][-1])
    if kind == "replay":
        settings |= {"rate": 1, "loop": 0}  # until stopped
    bus = {"connect": ["${RSENF_CONNECT}"]}
    nodes = with_files({NODE: settings}, {**named, "OUT": str(tmp_path / "out.mcap")})
    if kind == "record":
        nodes[NODE]["archive"] = str(tmp_path / "archive")
        del nodes[NODE]["out"]
    path = write(tmp_path / "graph.yaml", nodes, site=SITE, bus=bus)
    node = Graph.model_validate(yaml.safe_load(path.read_text())).nodes[NODE]
    reads = [str(read.stream) for read in node.inputs()]
    sends = [str(stream) for stream in node.outputs()]
    command = [sys.executable, "-m", "rsenf_nodes", "--graph", str(path), "--node", NODE]
    broken = [check for check in check_contract(command, reads, sends) if not check.passed]
    assert broken == []


@pytest.mark.processes
def test_every_setting_of_a_stage_is_run_again_as_it_was(
    named: dict[str, str], live_run: type[LiveRun], tmp_path: Path
) -> None:
    """A node's process and regress make the same of the same settings, whichever they are."""
    names = {**named, "OUT": str(tmp_path / "out.mcap")}
    nodes: dict[str, Any] = {}
    for kind in ("decode", "rows", "track", "idle", "match", "live", "discover"):
        for camera, variant in zip(("a", "b"), VARIANTS[kind], strict=True):
            settings = placed(kind, variant, (camera,))
            if kind == "decode":
                # Paced: `live` waits 3 s for estimates, and what it says after that hangs on how
                # far a slow machine's tracker was by then.
                settings |= {"camera": camera, "pace": True}
            nodes[f"{kind}_{camera}"] = settings
    del nodes["rows_a"]  # fused
    del nodes["idle_a"]  # the tracker's
    nodes["reference"] = placed("reference", VARIANTS["reference"][0])
    nodes["record"] = placed("record", VARIANTS["record"][0])
    path = write(tmp_path / "graph.yaml", with_files(nodes, names))
    run = live_run(path)
    assert wait_until(lambda: run.process.poll() is not None, 240), run.lines  # 75 s of film
    assert run.wait() == EXIT_DONE, run.lines
    graph = load_graph(path)
    result = regress(names["OUT"])
    assert result.exact
    assert result.left_out == {}
    assert [(t.topic, t.fields, t.unjudged) for t in result.topics if not t.passed] == []
    assert not [t.topic for t in result.topics if t.unjudged or not t.messages]
    made = {
        f"rsenf/lab/{of}/{topic}"
        for node in graph.nodes.values()
        for topic, of in node.outputs()
        if node.stages()
    } - {"rsenf/lab/a/video"}
    assert (
        {t.topic for t in result.topics}
        == made
        == {topic for topic in open_recording(names["OUT"]).topics if topic in made}
    )
