"""The graph of processes and the one-process run agree in every bit; nothing is lost on the way."""

from __future__ import annotations

import hashlib
import threading
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import Film, Graphs
from run_samples import children_of

from rsenf.api.shared import row_settings
from rsenf.bus.inbox import Inbox
from rsenf.bus.ring import ring_directory
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import load_graph
from rsenf.match.stage import Match
from rsenf.messages import canonical
from rsenf.record import open_recording
from rsenf.reference import read_reference, reference_blocks
from rsenf.rows.settings import RowsSettings
from rsenf.run.inline import analyse
from rsenf.run.inputs import open_input_file
from rsenf.run.recording import DELIVERY
from rsenf.run.supervisor import check_ended, start_graph

pytestmark = pytest.mark.processes

Stream = dict[str, list[Any]]


def in_one_process(graph_path: Path, film: Film) -> Stream:
    """What ``rsenf verify`` and ``rsenf idle`` compute, with the settings of the graph."""
    graph = load_graph(graph_path)
    kinds: dict[str, Any] = {node.kind: node for node in graph.nodes.values()}
    track, match = kinds["track"], kinds["match"]
    idle = track.idle or kinds["idle"].idle
    reference = read_reference(str(film.reference), grid=match.grid)
    out: Stream = defaultdict(list)
    analyse(
        open_input_file(film.video, source="lab/cam"),
        rows=row_settings(RowsSettings(), track.track),
        track=track.track,
        idle=idle,
        make_match=lambda: Match(method=match.method, grid=match.grid, settings=match.match),
        reference=list(reference_blocks(reference, source=f"reference/{match.grid}")),
        tap=lambda topic, message: out[topic].append(message),
    )
    return out


def as_processes(graph_path: Path) -> tuple[Stream, Inbox, str]:
    """What a listener on the bus receives of a run, from its first message to its last."""
    graph, heard = load_graph(graph_path), Inbox()
    out: Stream = defaultdict(list)
    with start_graph(graph, graph_path) as run:
        with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
            bus.subscribe(heard, "rsenf/lab/**", DELIVERY)
            done = threading.Event()

            def listen() -> None:
                while not done.is_set() or heard.depth:
                    if received := heard.receive(0.1):
                        topic = received.key.split("/")[-1]
                        out[topic].append(received.message)

            listening = threading.Thread(target=listen)
            listening.start()
            run.wait(threading.Event())
            done.set()
            listening.join(20)
        assert check_ended(run) == 0, {n.name: n.detail for n in run.nodes.values()}
    assert children_of(run.run_id) == []
    assert list(ring_directory().glob(f"rsenf-{run.run_id}*")) == []
    return out, heard, run.run_id


def bits(messages: list[Any]) -> list[bytes]:
    return [canonical(m) for m in messages]


@pytest.mark.parametrize(
    ("frames", "method", "matcher", "together"),
    [
        ("ring", "stft", "phase", False),
        ("tcp", "stft", "phase", True),
        ("fused", "projection", "phase", True),
        ("fused", "paper", "metric4", False),
        ("ring", "superpixel", "phase", False),
    ],
)
def test_bit_identical_and_nothing_lost(
    film: Film, graphs: Graphs, frames: str, method: str, matcher: str, together: bool
) -> None:
    path = graphs.write(film, frames, method=method, matcher=matcher, together=together)
    expected = in_one_process(path, film)
    on_bus, heard, run_id = as_processes(path)

    recording = open_recording(graphs.out)
    recorded: Stream = defaultdict(list)
    for topic, message, _ in recording.messages():
        recorded[topic.split("/")[-1]].append(message)
    assert recording.complete
    assert not recording.loss
    assert recording.metadata["rsenf"]["run_id"] == run_id

    for topic in ("rows", "track", "idle", "match"):
        *data, end = on_bus[topic]
        assert expected[topic]
        assert bits(data) == bits(expected[topic]), topic
        assert bits(recorded[topic]) == [*bits(data), canonical(end)], topic
        assert [m.header.seq for m in on_bus[topic]] == list(range(len(data) + 1))
        assert end.header.is_end
    (result,) = recorded["match"][:-1]
    assert result.decision == "match" or method != "stft"
    assert abs(result.lag_s - film.lag_s) < 1.0
    *earlier, idle = recorded["idle"][:-1]
    assert len(earlier) >= 5  # it sharpens as the stream goes on
    assert idle.verdict == "estimated"
    assert abs(idle.idle_ratio - film.idle_ratio) < 0.01

    assert (heard.counters.missed, heard.counters.dropped, heard.counters.rejected) == (0, 0, 0)
    names = {m.header.run_id for topic in ("rows", "track", "idle", "match") for m in on_bus[topic]}
    assert names == {run_id}
    # Every frame and every packet of the video, by its number, and the whole reference.
    frames_of_film = sum(b.frames for b in expected["rows"])
    for topic in ("frames", "video") if frames != "fused" else ("video",):
        numbers = [m.header.seq for m in recorded[topic]]
        assert numbers == list(range(frames_of_film + 1)), topic
    assert sum(b.samples for b in recorded["ce"]) == 1200


def test_the_recording_says_what_it_was_made_of(film: Film, graphs: Graphs) -> None:
    path = graphs.write(film, "fused")
    with_secret = path.read_text().replace(
        "site: lab", "site: lab\nbus: {zenoh: {transport/auth/usrpwd/password: hunter2}}"
    )
    path.write_text(with_secret)
    _, _, run_id = as_processes(path)
    metadata = open_recording(graphs.out).metadata
    about = metadata["rsenf"]
    assert (about["run_id"], about["site"]) == (run_id, "lab")
    config = yaml.safe_load(about["config"])
    assert config["nodes"]["track"]["track"]["window_s"] == 20.0  # defaults too
    assert config["nodes"]["decode"]["input"] == str(film.video)
    assert b"hunter2" not in graphs.out.read_bytes()
    for node, file in (("decode", film.video), ("grid", film.reference)):
        sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
        assert metadata[f"rsenf.input.{node}"]["input_sha256"] == sha256
