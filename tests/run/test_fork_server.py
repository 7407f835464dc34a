"""Nodes are forked from one process: their exit codes, descriptors, titles, and its own end."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import pickle
import resource
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from multiprocessing import Pipe
from pathlib import Path

import psutil
import pytest
from run_samples import GRAPH

from rsenf.config import Graph
from rsenf.errors import EXIT_FAILED, EXIT_USAGE
from rsenf.run.fork_server import ForkedProcess, ForkServer, serve
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
    os.write(graph, pickle.dumps(Graph.model_validate(GRAPH)))
    words = ["rsenf_nodes", "--graph", "g.yaml", "--node", "rose", "--held", str(graph)]
    # The graph is read, and found to have no such node; unread, it is another exit code.
    assert server.start(words, [other, graph]).wait(60.0) == EXIT_USAGE
    assert server.start(words, [graph, other]).wait(60.0) == EXIT_USAGE
    os.ftruncate(graph, 0)
    assert server.start(words, [other, graph]).wait(60.0) not in (0, EXIT_USAGE)
    os.close(graph)
    os.close(other)


@pytest.mark.parametrize("free", [0, 1])
def test_without_free_descriptors_it_refuses_and_goes_on(server: ForkServer, free: int) -> None:
    words = ["rsenf_nodes", "--graph", "none.yaml", "--node", "rows"]
    assert server.start(words).wait(60.0) == EXIT_USAGE
    number = server._process.pid
    before = resource.prlimit(number, resource.RLIMIT_NOFILE)
    folder = Path(f"/proc/{number}/fd")

    def shown() -> dict[int, str]:
        found = {}
        for entry in folder.iterdir():
            with contextlib.suppress(FileNotFoundError):  # closed since
                found[int(entry.name)] = os.readlink(entry)
        return {number: what for number, what in found.items() if number > 2}

    assert wait_until(lambda: not any("pipe" in w or "pidfd" in w for w in shown().values()))
    unused = [n for n in range(3, 100) if n not in shown()]
    resource.prlimit(number, resource.RLIMIT_NOFILE, (unused[free], before[1]))
    with pytest.raises(OSError, match=r"[Tt]oo many (open )?files"):
        server.start(words)
    resource.prlimit(number, resource.RLIMIT_NOFILE, before)
    assert server.start(words).wait(60.0) == EXIT_USAGE
    assert server._process.pid == number


def zombie(pid: int) -> bool:
    return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


def test_what_changes_in_the_environment_reaches_a_node(
    server: ForkServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, elsewhere = tmp_path / "graph.yaml", "tcp/127.0.0.1:9"
    path.write_text(json.dumps({**GRAPH, "site": "${RSENF_TEST_SITE}"}))
    words = ["rsenf_nodes", "--graph", str(path), "--node", "rows", "--connect", elsewhere]
    assert server.start(words).wait(60.0) == EXIT_USAGE
    monkeypatch.setenv("RSENF_TEST_SITE", "lab")
    assert server.start(words).wait(60.0) == EXIT_FAILED  # it finds no bus
    monkeypatch.delenv("RSENF_TEST_SITE")
    assert server.start(words).wait(60.0) == EXIT_USAGE


def test_a_fork_that_fails_is_an_error_of_its_node(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise BlockingIOError(errno.EAGAIN, "no more processes")

    def end(code: int) -> None:
        raise SystemExit(code)

    monkeypatch.setattr(os, "fork", refused)
    monkeypatch.setattr(os, "_exit", end)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)

    def work() -> None:
        with contextlib.suppress(SystemExit):
            serve(theirs)

    serving = threading.Thread(target=work)
    serving.start()
    for _ in range(2):  # it goes on
        told, tells = Pipe(duplex=False)
        with tells:
            socket.send_fds(ours, [b"{}"], [tells.fileno()])
        with pytest.raises(OSError, match="no more processes"):
            ForkedProcess(told)
    ours.close()
    serving.join()


def test_a_killed_server_is_started_again(server: ForkServer, tmp_path: Path) -> None:
    process = waiting(server, tmp_path)
    parent = psutil.Process(process.pid).parent()
    assert parent is not None
    parent.kill()
    assert process.wait(60.0) == -signal.SIGKILL
    assert not psutil.pid_exists(process.pid) or zombie(process.pid)  # killed, too
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
