"""Starts the nodes of a run by fork, from one process that has already imported what they need.

Importing takes most of a node's start, and what is imported before the fork is memory that all
nodes share. The supervisor can't fork itself, since it has threads and a Zenoh session: the fork
server has neither. Each node has a pipe, on which the server writes the process id, or why there is
none, then the exit code. The server is the parent of the nodes; it ends with the supervisor, and
the nodes with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path

MODULE = "rsenf.run.fork_server"
# Imported by most nodes, and so before the first fork.
PRELOADED = (
    "rsenf.run.node",
    "rsenf.run.pump",
    "rsenf.run.outlets",
    "rsenf.decode.file",
    "rsenf.rows.stage",
)
_MOST_BYTES, _MOST_DESCRIPTORS = 2**16, 16  # of a request
# Space for a node's command line, which replaces the server's.
_TITLE_BYTES = 4096


class ForkedProcess:
    """A process started by the fork server; used like a :class:`subprocess.Popen`.

    Parameters
    ----------
    receiver : Connection
        From it come the process id, then the exit code, as the server sends them.

    Raises
    ------
    OSError
        When the server has ended, or can't fork.
    """

    def __init__(self, receiver: Connection) -> None:
        self._receiver = receiver
        try:
            answer: int | str = receiver.recv()
        except EOFError:
            answer = "the fork server has ended, or too many files are open in it"
        if isinstance(answer, str):
            raise OSError(answer)
        self.pid = answer
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code; None while the process lives."""
        return self._await(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end, return the exit code; raises TimeoutExpired, as Popen's does."""
        code = self._await(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return code

    def _await(self, timeout_s: float | None) -> int | None:
        if self.returncode is None and self._receiver.poll(timeout_s):
            try:
                self.returncode = self._receiver.recv()
            except EOFError:  # the server was killed, so that nobody will know the exit code
                kill_and_wait(self.pid)
                self.returncode = -signal.SIGKILL
            self._receiver.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)


def kill_and_wait(pid: int) -> None:
    """Kill a process that isn't a child of this one, and wait for its end."""
    with contextlib.suppress(ProcessLookupError):
        descriptor = os.pidfd_open(pid)
        try:
            signal.pidfd_send_signal(descriptor, signal.SIGKILL)
            select.select([descriptor], [], [])
        finally:
            os.close(descriptor)


# A node, or a program of the user's.
Process = subprocess.Popen[bytes] | ForkedProcess


@dataclass
class ForkServer:
    """The supervisor's end; started with the ``with`` block, and again if it was killed.

    Parameters
    ----------
    modules : sequence of str
        Imported before the first fork, besides :data:`PRELOADED`.
    environment : mapping
        What is added to that of this process, for the server and every node.
    stdout : int, optional
        Descriptor that the nodes print to.
    """

    modules: Sequence[str]
    environment: Mapping[str, str]
    stdout: int | None = None
    _requests: socket.socket = field(init=False)
    _process: subprocess.Popen[bytes] = field(init=False)
    _inherited: dict[str, str] = field(init=False)  # environment that the server began with

    def _surroundings(self) -> dict[str, str]:
        return {**os.environ, **self.environment}

    def __enter__(self) -> ForkServer:
        self._inherited = self._surroundings()
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [
            sys.executable,
            "-m",
            MODULE,
            str(theirs.fileno()),
            " ".join(self.modules).ljust(_TITLE_BYTES),
        ]
        # Blocked until a node can take it: before, it would end the process.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
        try:
            # A new session: Ctrl-C reaches only the supervisor, which stops the nodes in order.
            self._process = subprocess.Popen(
                command,
                env=self._inherited,
                stdin=subprocess.DEVNULL,
                stdout=self.stdout,
                start_new_session=True,
                pass_fds=[theirs.fileno()],
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
        return self

    def __exit__(self, *error: object) -> None:
        self._requests.close()
        self._process.wait()

    def start(self, arguments: Sequence[str], inherited: Sequence[int] = ()) -> ForkedProcess:
        """Start a node.

        Parameters
        ----------
        arguments : sequence of str
            Its command line, without the id of its parent, which is added.
        inherited : sequence of int
            Open descriptors that the node gets by the same numbers.

        Raises
        ------
        OSError
            When the server can't be started, or can't fork.
        """
        if self._process.poll() is not None:
            self.__exit__()
            self.__enter__()
        words = [*arguments, "--supervisor", str(self._process.pid)]
        before, now = self._inherited, self._surroundings()
        changed = {n: now.get(n) for n in before | now if before.get(n) != now.get(n)}
        receiver, sender = Pipe(duplex=False)
        with sender:
            request = json.dumps([words, changed, list(inherited)]).encode()
            socket.send_fds(self._requests, [request], [sender.fileno(), *inherited])
        return ForkedProcess(receiver)


def serve(requests: socket.socket) -> None:
    """Fork a process at each request, in which the function returns; ends with the supervisor."""
    children: dict[int, tuple[int, Connection]] = {}  # by their pidfd
    ends = select.poll()
    ends.register(requests, select.POLLIN)
    while True:
        for ready, _ in ends.poll():
            if ready in children:
                pid, sender = children.pop(ready)
                ends.unregister(ready)
                os.close(ready)
                _, status = os.waitpid(pid, 0)
                with sender, contextlib.suppress(OSError):
                    sender.send(os.waitstatus_to_exitcode(status))
                continue
            request, descriptors, _, _ = socket.recv_fds(requests, _MOST_BYTES, _MOST_DESCRIPTORS)
            if not request:
                os._exit(0)
            if not descriptors:  # none is free to take the pipe, whose end is the answer
                continue
            sender = Connection(descriptors[0], readable=False)
            try:
                pid = os.fork()
            except OSError as exc:  # too many processes, or too little memory
                sender.send(f"it can't be forked: {exc.strerror}")
                sender.close()
                pid = -1
            if not pid:
                requests.close()
                sender.close()
                for other, (_, of_other) in children.items():
                    os.close(other)
                    of_other.close()
                _become(request, descriptors[1:])
                return
            for descriptor in descriptors[1:]:
                os.close(descriptor)
            if pid > 0:
                try:
                    child = os.pidfd_open(pid)
                except OSError as exc:
                    os.kill(pid, signal.SIGKILL)
                    os.waitpid(pid, 0)
                    sender.send(f"it can't be watched: {exc.strerror}")
                    sender.close()
                    continue
                sender.send(pid)
                children[child] = pid, sender
                ends.register(child, select.POLLIN)


def _become(request: bytes, descriptors: Sequence[int]) -> None:
    """Make a forked process that of the node."""
    words, changed, numbers = json.loads(request)
    os.setsid()
    free = max([2, *descriptors, *numbers]) + 1  # a number may be in use, by another one of them
    kept = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, free) for descriptor in descriptors]
    for descriptor, number in zip(kept, numbers, strict=True):
        os.dup2(descriptor, number)
    for descriptor in {*descriptors, *kept} - {*numbers}:
        os.close(descriptor)
    for name, value in changed.items():
        os.environ.pop(name, None)
        if value is not None:
            os.environ[name] = value
    sys.argv = words
    _set_title([sys.executable, "-m", *words])


def _set_title(words: Sequence[str]) -> None:
    """Overwrite the command line, by which ps shows a process, where the server's began."""
    after_name = Path("/proc/self/stat").read_text(encoding="ascii").rpartition(") ")[2].split()
    begin, end = map(int, after_name[45:47])  # arg_start and arg_end of proc_pid_stat(5)
    title = b"\0".join(map(os.fsencode, words))[: end - begin - 1]
    ctypes.memmove(begin, title.ljust(end - begin, b"\0"), end - begin)


def main() -> None:
    """Run the fork server, and in its children the nodes."""
    for name in (*PRELOADED, *sys.argv[2].split()):
        importlib.import_module(name)
    gc.collect()
    gc.freeze()  # else the first collection of each node would copy all of it
    serve(socket.socket(fileno=int(sys.argv[1])))
    importlib.import_module("rsenf_nodes.__main__")


if __name__ == "__main__":
    main()
