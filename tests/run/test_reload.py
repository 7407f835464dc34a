"""A running graph takes its changed file, and the cameras that stay lose nothing."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from conftest import Film
from live_run import LiveRun

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import Delivery, camera_key
from rsenf.bus.zenoh_bus import BusSettings, open_bus
from rsenf.errors import EXIT_DONE, EXIT_USAGE
from rsenf.record import open_recording
from rsenf.run import process
from rsenf.run.process import ask_to_reload, wait_until

pytestmark = pytest.mark.processes

HEAD = "version: 1\nsite: lab\nnodes:\n"
CAMERA = '  {name}: {{kind: decode, camera: {name}, input: "{video}", frames: fused, pace: true}}\n'
TRACK = "  track: {{kind: track, cameras: [{cameras}], track: {{window_s: {window_s}}}}}\n"
AFTERWARDS = Delivery(lossless=False, queue=256, history=0)  # what is sent from now on
RECORD = '  record: {{kind: record, out: "{out}"}}\n'


class Site:
    """A graph of paced films, whose cameras change."""

    def __init__(self, folder: Path, video: Path) -> None:
        self.graph, self.out, self._video = folder / "graph.yaml", folder / "out.mcap", video

    def write(self, *cameras: str, window_s: int = 16) -> None:
        """Write the graph with these cameras."""
        text = HEAD + "".join(CAMERA.format(name=c, video=self._video) for c in cameras)
        text += TRACK.format(cameras=", ".join(cameras), window_s=window_s)
        self.graph.write_text(text + RECORD.format(out=self.out), encoding="utf-8")

    def frames(self, camera: str) -> list[int]:
        """Numbers of the frames whose rows were recorded, in order."""
        found: list[int] = []
        for topic, message, _ in open_recording(self.out).messages():
            if topic.endswith(f"/{camera}/rows") and not message.header.is_end:
                found += range(message.header.frame_first, message.header.frame_last + 1)
        return found


def told(run: LiveRun, text: str) -> None:
    assert wait_until(lambda: any(text in line for line in run.lines), 60), "\n".join(run.lines)


def test_cameras_come_and_go_and_those_that_stay_lose_no_frame(
    film: Film,
    live_run: type[LiveRun],
    rsenf: Callable[..., subprocess.CompletedProcess[str]],
    tmp_path: Path,
) -> None:
    site = Site(tmp_path, film.video)
    site.write("stays", "goes")
    run = live_run(site.graph).until("running", "stays", "goes", "track", "record")
    decoder = run.pids["stays"]
    site.write("stays", "comes", window_s=12)
    words = "reloaded: removed goes; new comes; started again track"
    done = rsenf("reload", site.graph)
    assert (done.returncode, done.stderr) == (EXIT_DONE, "")
    assert done.stdout == f"process {run.process.pid}: {words}\n"
    told(run, words)
    run.until("running", "comes").until("done", "goes")
    assert wait_until(lambda: run.states["track"].count("running") > 1, 60), "\n".join(run.lines)
    with open_bus(BusSettings(connect=(run.endpoint,))) as bus:
        tracked, rows = Inbox(), Inbox()
        bus.subscribe(tracked, camera_key("lab", "stays", "track"), AFTERWARDS)
        assert tracked.receive(60), "\n".join(run.lines)
        run.process.send_signal(signal.SIGHUP)
        told(run, "reloaded: no node has changed")
        bus.subscribe(rows, camera_key("lab", "stays", "rows"), AFTERWARDS)
        after = rows.receive(60)
        assert after is not None, "\n".join(run.lines)
    assert run.pids["stays"] == decoder
    run.interrupt()
    assert run.process.returncode == EXIT_DONE, "\n".join(run.lines)
    frames = site.frames("stays")
    assert frames == list(range(len(frames)))
    assert len(frames) > after.message.header.frame_last > 30
    for camera in ("goes", "comes"):
        assert site.frames(camera)


def test_a_file_with_mistakes_changes_nothing(
    film: Film,
    live_run: type[LiveRun],
    rsenf: Callable[..., subprocess.CompletedProcess[str]],
    tmp_path: Path,
) -> None:
    site = Site(tmp_path, film.video)
    site.write("cam")
    run = live_run(site.graph).until("running", "cam", "track", "record")
    pids = dict(run.pids)
    right = site.graph.read_text()
    mistakes = {
        "trakc": right.replace("kind: track", "kind: trakc"),
        "'site' has changed": right.replace("lab", "shed"),
    }
    for why, wrong in mistakes.items():
        site.graph.write_text(wrong)
        run.process.send_signal(signal.SIGHUP)
        assert wait_until(
            lambda why=why: any("not reloaded: " in x and why in x for x in run.lines), 60
        ), "\n".join(run.lines)
        assert run.pids == pids
    for why, wrong in mistakes.items():
        site.graph.write_text(wrong)
        refused = rsenf("reload", site.graph)
        assert (refused.returncode, refused.stdout) == (EXIT_USAGE, "")
        assert why in refused.stderr
    run.interrupt()
    assert run.process.returncode == EXIT_DONE, "\n".join(run.lines)


ANSWERING = """
import sys, time
from pathlib import Path
from rsenf.run.process import ReloadRequests

with ReloadRequests(Path(sys.argv[1])) as requests:
    print(flush=True)
    while not requests.pending():
        time.sleep(0.01)
    if sys.argv[2] != "ends":
        requests.answer(sys.argv[2], accepted=sys.argv[2] == "yes")
"""


@contextmanager
def answering(graph: Path, *answers: str) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Stand for runs of a graph, each of which answers once."""
    command = [sys.executable, "-X", "dev", "-c", ANSWERING, str(graph)]
    with contextlib.ExitStack() as stack:
        runs = []
        for answer in answers:
            run = subprocess.Popen([*command, answer], stdout=subprocess.PIPE)
            runs.append(stack.enter_context(run))
            stack.callback(run.kill)
            assert run.stdout is not None
            run.stdout.readline()
        yield runs


def test_all_runs_of_a_file_answer_however_they_were_started(tmp_path: Path) -> None:
    graph, link = tmp_path / "graph.yaml", tmp_path / "link.yaml"
    link.symlink_to(graph)
    with answering(graph, "yes", "no", "ends") as runs, answering(tmp_path / "other.yaml", "yes"):
        yes, no, ends = [run.pid for run in runs]
        answers = ask_to_reload(link)
    gone = "not reloaded: it has ended, or doesn't answer"
    assert answers == {yes: (True, "yes"), no: (False, "no"), ends: (False, gone)}
    assert ask_to_reload(graph) == {}


def test_a_killed_run_is_not_asked(tmp_path: Path) -> None:
    graph = tmp_path / "graph.yaml"
    with answering(graph, "yes", "yes") as (killed, lives):
        killed.kill()
        killed.wait()
        left = process._reload_socket(graph, str(killed.pid))
        assert left.exists()
        assert ask_to_reload(graph) == {lives.pid: (True, "yes")}
        assert not left.exists()


def test_nothing_that_runs_is_said(
    rsenf: Callable[..., subprocess.CompletedProcess[str]], film: Film, tmp_path: Path
) -> None:
    site = Site(tmp_path, film.video)
    site.write("cam")
    words = ["-c", "import time; print(flush=True); time.sleep(1000)  # rsenf"]
    bystander = subprocess.Popen(
        [sys.executable, *words, "run", str(site.graph)], stdout=subprocess.PIPE
    )
    with bystander:
        assert bystander.stdout is not None
        bystander.stdout.readline()
        refused = rsenf("reload", site.graph)
        bystander.terminate()
    assert bystander.returncode == -signal.SIGTERM
    assert refused.returncode == EXIT_USAGE
    assert "nothing runs" in refused.stderr
