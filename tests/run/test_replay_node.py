"""A replay node in a graph, and in the place of another node: equal results, nothing lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Film, Graphs
from replay_graphs import from_topic, graph, in_many_processes
from replay_samples import RESULTS, in_one_process, record

from rsenf.bus.inbox import Inbox
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.config import load_graph
from rsenf.errors import EXIT_DONE, EXIT_LOSS, ConfigError, UsageError
from rsenf.run.inputs import open_input_file
from rsenf.run.recording import DELIVERY
from rsenf.run.supervisor import free_endpoint

LIVE = """\
  decode: {{kind: decode, camera: cam, input: "{video}"}}
  rows: {{kind: rows, cameras: [cam]}}
  track: {{kind: track, cameras: [cam], track: {{nominal_hz: 50}}}}
"""


@pytest.fixture(scope="module")
def recorded(short_film: Film, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(short_film, tmp_path_factory.mktemp("replay") / "film.mcap")


@pytest.fixture(scope="module")
def expected(short_film: Film) -> dict[str, str]:
    film = in_one_process(open_input_file(short_film.video, source="lab/cam"), short_film)
    return {topic: film[topic] for topic in RESULTS}


@pytest.mark.processes
@pytest.mark.parametrize(("begin", "rate"), [("frames", 0), ("rows", 10), ("track", 1)])
def test_a_graph_fed_by_a_recording(
    recorded: Path,
    short_film: Film,
    expected: dict[str, str],
    tmp_path: Path,
    begin: str,
    rate: float,
) -> None:
    out = tmp_path / "out.mcap"
    path = graph(short_film, from_topic(recorded, begin, rate), out)
    assert in_many_processes(path, out, {}) == (expected, EXIT_DONE)


@pytest.mark.processes
@pytest.mark.parametrize("node", ["decode", "rows"])
def test_one_node_played_and_the_rest_live(
    recorded: Path, short_film: Film, expected: dict[str, str], tmp_path: Path, node: str
) -> None:
    out = tmp_path / "out.mcap"
    path = graph(short_film, LIVE.format(video=short_film.video), out)
    assert in_many_processes(path, out, {node: str(recorded)}) == (expected, EXIT_DONE)


@pytest.mark.processes
def test_a_truncated_recording_says_so_in_a_graph(
    recorded: Path, short_film: Film, tmp_path: Path
) -> None:
    cut, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size * 2 // 3])
    _, code = in_many_processes(graph(short_film, from_topic(cut, "rows", 0), out), out, {})
    assert code == EXIT_LOSS


@pytest.mark.processes
def test_the_verb_plays_to_whoever_listens(recorded: Path) -> None:
    endpoint, heard = free_endpoint(), Inbox()
    words = ["replay", recorded, "--listen", endpoint, "--topics", "cam/rows", "--rate", 0,
             "--rename", "cam=door", "--site", "home", "--loop", 2, "--json"]  # fmt: skip
    command = [sys.executable, "-m", "rsenf.cli", *map(str, words)]
    with subprocess.Popen(command, stdout=-1, stderr=-1, stdin=-3, text=True) as process:
        assert process.stderr
        assert "waiting for a listener" in process.stderr.readline()
        seen = []
        with open_bus(BusSettings(connect=(endpoint,))) as bus:
            bus.subscribe(heard, "rsenf/home/door/rows", DELIVERY)
            while not seen or not seen[-1].is_end:
                received = heard.receive(30)
                assert received
                seen.append(received.message.header)
        out, errors = process.communicate(timeout=120)
    assert process.returncode == EXIT_DONE, errors
    blocks = (len(seen) - 1) // 2
    assert [(h.epoch, h.seq) for h in seen[:-1]] == [(e, n) for e in (0, 1) for n in range(blocks)]
    assert f'"rsenf/home/door/rows": {2 * blocks}' in out
    assert heard.counters.missed == 0


def test_what_cant_be_replaced(short_film: Film, graphs: Graphs) -> None:
    path = graphs.write(short_film)
    with pytest.raises(UsageError, match="no node 'rovs' to replay") as refused:
        load_graph(path, {"rovs": "x.mcap"})
    assert "'rows'" in refused.value.hint
    with pytest.raises(UsageError, match="'record' sends nothing"):
        load_graph(path, {"record": "x.mcap"})
    with pytest.raises(UsageError, match=r"'record' would write to .*out.mcap, which is played"):
        load_graph(path, {"rows": str(graphs.out)})


@pytest.mark.parametrize(
    ("node", "words"),
    [
        ("topics: [cam]", "no topic: CAMERA/TOPIC"),
        ("topics: [cam/health]", "no topic"),
        ("topics: [cam/rows], rate: -1", "rate"),
        ("topics: [cam/rows], start_s: 5, end_s: 4", "isn't after start_s"),
        ("topics: [cam/rows]}\n  rec: {kind: record, out: ./x.mcap", "x.mcap is played by this"),
        ("topics: [cam/rows, door/rows], rename: {door: cam}", "stands here twice"),
    ],
)
def test_a_replay_node_that_cant_be(tmp_path: Path, node: str, words: str) -> None:
    path = tmp_path / "g.yaml"
    path.write_text(
        f"version: 1\nsite: lab\nnodes:\n  play: {{kind: replay, input: x.mcap, {node}}}\n"
    )
    with pytest.raises(ConfigError, match=words):
        load_graph(path)
