"""Nodes are forked from one process: their exit codes, descriptors, titles, and its own end."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from rsenf.errors import EXIT_USAGE
from rsenf.run.fork_server import ForkedProcess, ForkServer
from rsenf.run.process import wait_until

pytestmark = pytest.mark.processes


@pytest.fixture
def server() -> Iterator[ForkServer]:
    with ForkServer(("rsenf_nodes.rows",), {"OPENBLAS_NUM_THREADS": "1"}) as opened:
        yield opened


def waiting(server: ForkServer, tmp_path: Path, name: str = "rows") -> ForkedProcess:
    """Start a node that waits for its graph for ever: the file is a pipe that nobody writes."""
    path = tmp_path / f"{name}.yaml"
    os.mkfifo(path)
    return server.start(["rsenf_nodes", "--graph", str(path), "--node", name])


def test_a_node_ends_with_its_exit_code(server: ForkServer, tmp_path: Path) -> None:
    words = ["rsenf_nodes", "--graph", str(tmp_path / "none.yaml"), "--node", "rows"]
    assert server.start(words).wait(60.0) == EXIT_USAGE


def test_a_node_is_shown_by_its_command_line_in_a_session_of_its_own(
    server: ForkServer, tmp_path: Path
) -> None:
    process = waiting(server, tmp_path)
    shown = psutil.Process(process.pid).cmdline
    assert wait_until(lambda: shown()[1:3] == ["-m", "rsenf_nodes"])
    assert shown()[shown().index("--node") + 1] == "rows"
    assert os.getsid(process.pid) == process.pid
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.0)
    process.send_signal(signal.SIGHUP)  # blocked until the node can take it
    process.send_signal(signal.SIGKILL)
    assert process.wait(60.0) == -signal.SIGKILL
    process.send_signal(signal.SIGKILL)  # to nobody


def test_a_node_inherits_descriptors_by_their_numbers(server: ForkServer) -> None:
    graph, other = os.memfd_create("graph"), os.memfd_create("other")
    os.write(graph, pickle.dumps("no graph"))
    words = ["rsenf_nodes", "--graph", "g.yaml", "--node", "rows", "--held", str(graph)]
    process = server.start(words, [other, graph])
    # It is read, but it isn't a graph.
    assert process.wait(60.0) not in (0, EXIT_USAGE, -signal.SIGKILL)
    os.close(graph)
    os.close(other)


def test_a_killed_server_is_started_again(server: ForkServer, tmp_path: Path) -> None:
    process = waiting(server, tmp_path)
    parent = psutil.Process(process.pid).parent()
    assert parent is not None
    parent.kill()
    assert process.wait(60.0) == -signal.SIGKILL
    os.kill(process.pid, signal.SIGKILL)  # a running node would have ended with its parent
    second = waiting(server, tmp_path, "track")
    assert psutil.Process(second.pid).ppid() != parent.pid
    second.send_signal(signal.SIGKILL)
    assert second.wait(60.0) == -signal.SIGKILL


def test_the_server_ends_with_its_block(tmp_path: Path) -> None:
    with ForkServer((), {}) as server:
        process = waiting(server, tmp_path)
        parent = psutil.Process(process.pid).parent()
        process.send_signal(signal.SIGKILL)
        assert process.wait(60.0) == -signal.SIGKILL
    assert parent is not None
    assert wait_until(lambda: not parent.is_running())
