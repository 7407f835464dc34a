"""What a run says at its end: done, done with loss, or what went wrong, in one line."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import Film, Graphs
from live_run import LiveRun

from rsenf.config import load_graph
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_LOSS, EXIT_USAGE
from rsenf.record import open_recording
from rsenf.run.restart_policy import end_of
from rsenf.run.supervisor import NodeState, check_ended, start_graph
from rsenf.run.view import view_of

pytestmark = pytest.mark.processes

NODES = ("decode", "rows", "track", "match", "record")


def test_a_finished_run_is_done_and_tells_the_verdict(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    run = live_run(graphs.write(film), "--json")
    printed, _ = run.process.stdout.read(), run.wait()  # type: ignore[union-attr]
    assert run.process.returncode == EXIT_DONE
    summary = json.loads(printed)
    assert {n["state"] for n in summary["nodes"].values()} == {"done"}
    assert summary["results"]["lab/cam"]["decision"] == "match"
    assert abs(summary["results"]["lab/cam"]["lag_s"] - film.lag_s) < 1
    up = [float(line.split()[1]) for line in run.lines if ": running pid" in line]
    print(f"six nodes are up after {max(up):.2f} s")
    assert all(run.states[name][0] == "running" for name in NODES)


def test_quiet_says_nothing_when_nothing_is_wrong(
    short_film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    run = live_run(graphs.write(short_film), "--quiet")
    assert run.wait() == EXIT_DONE
    assert run.lines == []


def test_a_truncated_file_is_done_with_loss(
    film: Film,
    graphs: Graphs,
    live_run: type[LiveRun],
    tmp_path: Path,
    rsenf: Callable[..., object],
) -> None:
    whole, cut = tmp_path / "whole.mkv", Film(tmp_path / "cut.mkv", film.reference, 0.0)
    rsenf("simulate", "--out", whole, "--duration-s", 3, "--size", "320x240")
    cut.video.write_bytes(whole.read_bytes()[: whole.stat().st_size * 2 // 3])
    run = live_run(graphs.write(cut))
    assert run.wait() == EXIT_LOSS
    assert run.states["decode"][-1] == "done"
    assert len([line for line in run.lines if "cut short" in line]) == 1
    assert open_recording(graphs.out).complete


def test_a_loss_of_which_no_word_got_through_is_no_failure() -> None:
    held_up = NodeState("door", "decode", state="running", detail="rtsp://10.0.0.7/1")
    state, detail = end_of(held_up, EXIT_LOSS)
    assert (state, "lost" in detail) == ("done", True)
    theirs = NodeState("siren", "external", state="running")
    assert end_of(theirs, EXIT_LOSS) == ("failed", "exit code 3")
    late = NodeState("grid", "reference", asked_to_end=True)
    assert end_of(late, -signal.SIGKILL) == ("done", "stopped before it began")
    late.state = "running"
    assert end_of(late, -signal.SIGKILL)[0] == "failed"


def refused_port() -> int:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        return int(nobody.getsockname()[1])


@pytest.mark.parametrize(
    ("change", "words", "code"),
    [
        (("{video}", "/nowhere/film.mp4"), "decode: /nowhere/film.mp4", EXIT_USAGE),
        (("{reference}", "/nowhere/grid.csv"), "grid: no reference file /nowhere", EXIT_USAGE),
        (("{out}", "/nowhere/out.mcap"), "record: ", EXIT_USAGE),
        (
            ("{video}", "rtsp://admin:hunter2@127.0.0.1:{port}/cam"),
            "decode: rtsp://***@127.0.0.1:{port}/cam: connection refused",
            EXIT_FAILED,
        ),
        (("{video}", "{text}"), "decode: {text} is not a video", EXIT_FAILED),
        (("{video}", "/dev/video77"), "decode: /dev/video77", EXIT_FAILED),
    ],
)
def test_what_can_not_begin_is_one_clear_line_and_ends_the_graph(
    film: Film,
    graphs: Graphs,
    live_run: type[LiveRun],
    tmp_path: Path,
    change: tuple[str, str],
    words: str,
    code: int,
) -> None:
    text, port = tmp_path / "text.mp4", refused_port()
    text.write_text("no video\n" * 100)
    path = graphs.write(film)
    names = {"{video}": film.video, "{reference}": film.reference, "{out}": graphs.out}
    new = change[1].format(text=text, port=port)
    path.write_text(path.read_text().replace(str(names[change[0]]), new))
    run = live_run(path, "--quiet")
    assert run.wait() == code, "\n".join(run.lines)
    assert run.error.startswith(f"rsenf: {words.format(text=text, port=port)}"), run.lines
    assert len(run.lines) == 2  # at once, and at the end
    assert "hunter2" not in "".join(run.lines)
    assert run.left == []


def test_a_recording_that_exists_is_not_replaced(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    graphs.out.write_bytes(b"precious")
    run = live_run(graphs.write(film))
    assert run.wait() == EXIT_USAGE
    assert run.error.startswith("rsenf: record: ")
    assert graphs.out.read_bytes() == b"precious"


def assert_recorded_until_full(run: LiveRun, out: Path) -> None:
    assert run.wait() == EXIT_FAILED
    assert run.error.startswith("rsenf: record: "), run.lines
    assert "Traceback" not in "".join(run.lines)
    ends = {name: states[-1] for name, states in run.states.items()}
    assert ends.pop("record") == "failed"
    assert set(ends.values()) == {"done"}
    assert run.left == []
    recording = open_recording(out)
    assert recording.complete
    numbers = [m.header.seq for t, m, _ in recording.messages() if t.endswith("/video")]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > 100


def test_a_run_may_stop_when_its_recorder_is_lost(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    path = graphs.write(film, pace=True)
    path.write_text(path.read_text().replace("nodes:", "on_record_loss: stop\nnodes:", 1))
    run = live_run(path, "--json").until("running", *NODES).until("done", "grid")
    run.kill_node("record")
    assert run.wait() == EXIT_FAILED
    assert run.error == "rsenf: record: killed by signal 9"
    summary = json.loads(run.process.stdout.read())  # type: ignore[union-attr]
    (alarm,) = summary["alarms"]["lab/cam"]
    assert (alarm["kind"], alarm["text"]) == ("unrecorded", "record: killed by signal 9")
    assert 0 < alarm["start_s"] < 75  # long before the film was over
    assert run.left == []


def test_files_that_may_not_grow_any_more(
    film: Film, graphs: Graphs, live_run: type[LiveRun]
) -> None:
    limit = 3_000_000  # leaves room for the ring of frames
    assert film.video.stat().st_size > limit, "the film must not fit"
    run = live_run(
        graphs.write(film, "fused"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert_recorded_until_full(run, graphs.out)
    assert "file too large" in run.error


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 3 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    words = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(folder)]
    if subprocess.run(words, capture_output=True, check=False).returncode:
        pytest.skip("may not mount a small disk here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.external
def test_a_disk_that_is_full(
    film: Film, graphs: Graphs, live_run: type[LiveRun], small_disk: Path
) -> None:
    out = small_disk / "out.mcap"
    run = live_run(graphs.write(film, out=str(out)))
    assert_recorded_until_full(run, out)
    assert "no space left" in run.error


def test_one_process_may_run_one_graph_after_another(short_film: Film, graphs: Graphs) -> None:
    """As a notebook or a test would: nothing of the first is in the second's way."""
    path = graphs.write(short_film, "fused")
    for _ in range(2):
        graphs.out.unlink(missing_ok=True)
        graph = load_graph(path)
        with view_of(graph, quiet=True) as view, start_graph(graph, path, view.update) as run:
            run.wait(threading.Event())
        assert check_ended(run) == EXIT_DONE
        assert run.latest["match"]["lab/cam"].decision == "no_decision"  # too short to tell


def test_leaving_the_block_stops_the_graph(film: Film, graphs: Graphs) -> None:
    path = graphs.write(film, pace=True)
    graph = load_graph(path)
    with start_graph(graph, path) as run:
        while not all(n.was_ready for n in run.nodes.values()):
            run.watch(0.05)
    assert run.running == []
    assert open_recording(graphs.out).complete
    assert check_ended(run) == EXIT_DONE


def test_a_node_that_was_stopped_before_it_could_listen_ended_well(
    short_film: Film, graphs: Graphs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each node sleeps after its fork, before it handles signals.
    (tmp_path / "sitecustomize.py").write_text(
        "import os, time\nos.register_at_fork(after_in_child=lambda: time.sleep(60))\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    path = graphs.write(short_film)
    with start_graph(load_graph(path), path) as run:
        run.stop()
    assert {node.exit_code for node in run.nodes.values()} == {-signal.SIGTERM}
    assert check_ended(run) == EXIT_DONE


def test_recording_a_camera_alone(film: Film, live_run: type[LiveRun], tmp_path: Path) -> None:
    """Nobody samples the frames: they are described in the recording, and hold nobody up."""
    path, out = tmp_path / "g.yaml", tmp_path / "o.mcap"
    path.write_text(
        "version: 1\nsite: lab\nnodes:\n"
        f'  decode: {{kind: decode, camera: cam, input: "{film.video}"}}\n'
        f'  record: {{kind: record, out: "{out}", topics: ["*/video", "*/frames"]}}\n'
    )
    run = live_run(path)
    assert run.wait() == EXIT_DONE
    topics = {t.name: t.messages for t in open_recording(out).topics.values()}
    assert topics["rsenf/lab/cam/video"] == topics["rsenf/lab/cam/frames"] > 2000
