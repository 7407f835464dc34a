"""A node started without ``rsenf run``, as on another host."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, ROWS, camera_key, health_key
from rsenf.bus.zenoh_bus import BusSettings, free_endpoint, open_bus
from rsenf.errors import EXIT_DONE, EXIT_FAILED, EXIT_INTERRUPTED, EXIT_USAGE
from rsenf.messages import Header, Health, Mark, RowBlock

pytestmark = pytest.mark.processes


@pytest.fixture
def endpoint() -> str:
    return free_endpoint()


@pytest.fixture
def graph(tmp_path: Path, endpoint: str) -> Path:
    path = tmp_path / "g.yaml"
    path.write_text(
        f"version: 1\nsite: lab\nbus: {{connect: ['{endpoint}']}}\nnodes:\n"
        "  track: {kind: track, cameras: [cam]}\n"
    )
    return path


def start(graph: Path, node: str = "track") -> subprocess.Popen[str]:
    words = ["-m", "rsenf_nodes", "--graph", str(graph), "--node", node]
    return subprocess.Popen([sys.executable, *words], stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("node", "code", "words"),
    [("track", EXIT_FAILED, "track: no bus at tcp/"), ("trakc", EXIT_USAGE, "no node 'trakc'")],
)
def test_it_says_itself_what_is_wrong(graph: Path, node: str, code: int, words: str) -> None:
    process = start(graph, node)
    _, errors = process.communicate()
    assert process.returncode == code
    assert words in errors
    assert len(errors.splitlines()) == 1


class Listener:
    """Follows the node's health."""

    def __init__(self) -> None:
        self.words = Inbox()

    def until(self, state: str) -> Health:
        while True:
            received = self.words.receive(30)
            assert received is not None
            if received.message.state == state:
                report = received.message
                assert isinstance(report, Health)
                return report


def test_it_runs_until_its_input_ends(graph: Path, endpoint: str) -> None:
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        listener = Listener()
        bus.subscribe(listener.words, health_key("lab", "*"), LOOKING)
        process = start(graph)
        report = listener.until("running")
        assert report.header.run_id  # its own, since none was given
        rows = bus.publisher(camera_key("lab", "cam", "rows"), ROWS)
        rows.send(RowBlock(header=Header(run_id="r", seq=0, mark=Mark.END)))
        assert process.wait(30) == EXIT_DONE
        assert listener.until("done").messages_in == 1
        assert process.communicate()[1] == ""


def test_interrupted_once_and_twice(graph: Path, endpoint: str) -> None:
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        listener = Listener()
        bus.subscribe(listener.words, health_key("lab", "*"), LOOKING)
        process = start(graph)
        listener.until("running")
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == EXIT_DONE
        listener.until("done")
        process.communicate()

        process = start(graph)
        listener.until("running")
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) in (EXIT_INTERRUPTED, EXIT_DONE)  # done, when it was quicker
        process.communicate()


def test_it_outlives_the_shell_that_started_it(graph: Path, endpoint: str) -> None:
    with open_bus(BusSettings(mode="router", listen=(endpoint,))) as bus:
        listener = Listener()
        bus.subscribe(listener.words, health_key("lab", "*"), LOOKING)
        words = f"{sys.executable} -m rsenf_nodes --graph {graph} --node track &"
        subprocess.run(["sh", "-c", words], check=True)
        report = listener.until("running")
        for _ in range(2):  # two more beats: it is still there, its parent isn't
            report = listener.until("running")
        os.kill(report.pid, signal.SIGTERM)
        listener.until("done")
