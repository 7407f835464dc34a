"""Starts the nodes of a run by fork, from one process that has already imported what they need.

Importing takes most of a node's start, and what is imported before the fork is memory that all
nodes share. The supervisor can't fork itself, since it has threads and a Zenoh session: the fork
server has neither. Each node has a pipe, on which the server writes the process id, then the exit
code. The server is the parent of the nodes; it ends with the supervisor, and the nodes with it.
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
from types import TracebackType

MODULE = "rsenf.run.fork_server"
# Imported by most nodes, and so before the first fork.
PRELOADED = (
    "rsenf.run.node",
    "rsenf.run.pump",
    "rsenf.run.outlets",
    "rsenf.decode.file",
    "rsenf.rows.stage",
)
_MOST_BYTES, _MOST_DESCRIPTORS = 2**17, 16  # of a request
# Space for a node's command line, which replaces the server's.
_TITLE_BYTES = 4096


class ForkedProcess:
    """A process started by the fork server; used like a :class:`subprocess.Popen`.

    Parameters
    ----------
    told : Connection
        Where the server writes the process id, then the exit code.

    Raises
    ------
    EOFError
        When the server has ended.
    """

    def __init__(self, told: Connection) -> None:
        self._told = told
        self.pid: int = told.recv()
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
        if self.returncode is None and self._told.poll(timeout_s):
            self.returncode = -signal.SIGKILL
            with contextlib.suppress(EOFError):  # the server was killed, and nobody knows the code
                self.returncode = self._told.recv()
            self._told.close()
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless the process has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)


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

    def __enter__(self) -> ForkServer:
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
                env={**os.environ, **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=self.stdout,
                start_new_session=True,
                pass_fds=[theirs.fileno()],
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            theirs.close()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None = None,
        value: BaseException | None = None,
        trace: TracebackType | None = None,
    ) -> None:
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
            When the server doesn't start.
        """
        if self._process.poll() is not None:
            self.__exit__()
            self.__enter__()
        words = [*arguments, "--supervisor", str(self._process.pid)]
        environment = {**os.environ, **self.environment}
        told, tells = Pipe(duplex=False)
        with tells:
            request = json.dumps([words, environment, list(inherited)]).encode()
            socket.send_fds(self._requests, [request], [tells.fileno(), *inherited])
        try:
            return ForkedProcess(told)
        except EOFError:
            raise OSError("the fork server has ended") from None


def serve(requests: socket.socket) -> None:
    """Fork a process at each request, in which the function returns; ends with the supervisor."""
    children: dict[int, tuple[int, Connection]] = {}  # by their pidfd
    while True:
        for ready in select.select([requests.fileno(), *children], [], [])[0]:
            if ready in children:
                pid, tells = children.pop(ready)
                os.close(ready)
                _, status = os.waitpid(pid, 0)
                with tells, contextlib.suppress(OSError):
                    tells.send(os.waitstatus_to_exitcode(status))
                continue
            request, descriptors, _, _ = socket.recv_fds(requests, _MOST_BYTES, _MOST_DESCRIPTORS)
            if not request:
                os._exit(0)
            pid = os.fork()
            if not pid:
                requests.close()
                os.close(descriptors[0])
                for other, (_, tells) in children.items():
                    os.close(other)
                    tells.close()
                _become(request, descriptors[1:])
                return
            for descriptor in descriptors[1:]:
                os.close(descriptor)
            tells = Connection(descriptors[0], readable=False)
            tells.send(pid)
            children[os.pidfd_open(pid)] = pid, tells


def _become(request: bytes, descriptors: Sequence[int]) -> None:
    """Make a forked process that of the node."""
    words, environment, numbers = json.loads(request)
    os.setsid()
    free = max([2, *descriptors, *numbers]) + 1  # a number may be in use, by another one of them
    kept = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, free) for descriptor in descriptors]
    for descriptor, number in zip(kept, numbers, strict=True):
        os.dup2(descriptor, number)
    for descriptor in {*descriptors, *kept} - {*numbers}:
        os.close(descriptor)
    os.environ.clear()
    os.environ.update(environment)
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
