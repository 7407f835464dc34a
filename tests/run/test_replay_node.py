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
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.cli import main
from rsenf.config import load_graph
from rsenf.errors import EXIT_DONE, EXIT_LOSS, EXIT_USAGE, ConfigError, UsageError
from rsenf.record.reader import open_recording
from rsenf.record.writer import Recorder
from rsenf.run.inputs import open_input_file
from rsenf.run.recording import DELIVERY

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
        out, errors = process.communicate()
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
        ("topics: [cam/rows], rename: {cam: a/b}", "play.rename: 'a/b' is no name"),
        ("topics: [cam/rows], rename: {cam: a b}", "play.rename: 'a b' is no name"),
        ("topics: [cam/rows], rename: {cam: reference}", "'reference' is taken"),
        ("topics: [cam/rows], rename: {cam/rows: x}", "play.rename: 'x' is no topic"),
        ("topics: [cam/rows], rename: {cam/rows: x/track}", "another message"),
        ("topics: [cam/rows], rename: {xx: y}", "'xx' isn't among the topics"),
        ("topics: [cam/rows], rename: {cam/video: y/video}", "'cam/video' isn't among the topics"),
    ],
)
def test_a_replay_node_that_cant_be(tmp_path: Path, node: str, words: str) -> None:
    path = tmp_path / "g.yaml"
    path.write_text(
        f"version: 1\nsite: lab\nnodes:\n  play: {{kind: replay, input: x.mcap, {node}}}\n"
    )
    with pytest.raises(ConfigError, match=words):
        load_graph(path)


def test_good_new_names(tmp_path: Path) -> None:
    path = tmp_path / "g.yaml"
    play = "topics: [cam/rows, cam/video, reference/ce], rename: {cam: a, cam/rows: b/rows, "
    path.write_text(
        "version: 1\nsite: lab\nnodes:\n  play: {kind: replay, input: x.mcap, "
        f"{play}reference/ce: reference/gb}}}}\n"
    )
    sent = load_graph(path).nodes["play"].outputs()
    assert sent == [("rows", "b"), ("video", "a"), ("reference", "gb")]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("nothere.mcap", "node 'decode': nothere.mcap: no such file"),
        ("film.mp4", "node 'decode': film.mp4: "),
        ("rows.mcap", "node 'decode': rows.mcap: nothing to play as 'cam/frames'"),
    ],
)
def test_what_cant_be_played_destroys_no_recording(
    recorded: Path, short_film: Film, graphs: Graphs, given: str, words: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """The graph's own recorder would begin over at once."""
    path = graphs.write(short_film)
    monkeypatch.chdir(graphs.folder)
    graphs.out.write_bytes(recorded.read_bytes())
    (graphs.folder / "film.mp4").write_bytes(short_film.video.read_bytes())
    with Recorder(graphs.folder / "rows.mcap", run_info={}, clock_ns=lambda: 1) as recorder:
        for key, message, _ in open_recording(recorded).messages(["rsenf/lab/cam/rows"]):
            recorder.write(key, message)
    assert main(["run", str(path), "--replay", f"decode={given}"]) != EXIT_DONE
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
    assert graphs.out.read_bytes() == recorded.read_bytes()


@pytest.mark.parametrize(
    ("play", "code", "words"),
    [
        ("input: film.mcap, topics: [cam/rows]", EXIT_DONE, ""),
        ("input: film.mcap, topics: [cam/live]", EXIT_USAGE, "nothing to play as 'cam/live'"),
        ("input: film.mcap, topics: [cam/rows], start_s: 99", EXIT_USAGE, "ends before 99 s"),
        ("input: later.mcap, topics: [cam/rows]", EXIT_DONE, "note: node 'play' plays later.mcap"),
    ],
)
def test_validate_looks_into_recordings(
    recorded: Path, tmp_path: Path, play: str, code: int, words: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(recorded.parent)
    path = tmp_path / "g.yaml"
    path.write_text(f"version: 1\nsite: lab\nnodes:\n  play: {{kind: replay, {play}}}\n")
    assert main(["validate", str(path)]) == code
    said = capsys.readouterr()
    assert words in said.err
    assert bool(said.err) == bool(words)
    assert bool(said.out) == (code == EXIT_DONE)
