"""``rsenf run`` in a process of its own, watched by what it prints."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, ClassVar

from run_samples import children_of

from rsenf.run.process import wait_until

LINE = re.compile(r"rsenf +([\d.]+) s +(\w+): (\w+)(?: pid (\d+))? ?(.*)")
LIMIT_S = 120.0  # against what hangs; how fast things are is said where it matters


class LiveRun:
    """A running graph.

    Parameters
    ----------
    graph : Path
        Its file.
    words : str
        More arguments of ``rsenf run``.
    """

    started: ClassVar[list[LiveRun]] = []

    def __init__(self, graph: Path, *words: str, **more: Any) -> None:
        self.graph, self.run_id, self.endpoint = graph, "", ""
        self.ready_s = 0.0  # from its beginning until the last of its nodes so far ran
        self.states: dict[str, list[str]] = {}
        self.pids: dict[str, int] = {}
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rsenf.cli", "run", str(graph), *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **more,
        )
        LiveRun.started.append(self)
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append(line.rstrip("\n"))
            if found := re.search(r"bus at (\S+), run (\w+)", line):
                self.endpoint, self.run_id = found.groups()
            elif found := LINE.match(line):
                after_s, name, state, pid, _ = found.groups()
                if state == "running" and state not in self.states.get(name, []):
                    self.ready_s = float(after_s)
                if pid:
                    self.pids[name] = int(pid)
                self.states.setdefault(name, []).append(state)  # last: it is waited for

    def until(self, state: str, *names: str) -> LiveRun:
        """Wait until nodes have been in a state."""

        def reached() -> bool:
            return all(state in self.states.get(name, []) for name in names)

        assert wait_until(reached, LIMIT_S), "\n".join(self.lines)
        return self

    def kill_node(self, name: str) -> float:
        """Kill a node; returns how long the run took to say that it is lost."""
        begun = time.monotonic()
        os.kill(self.pids[name], signal.SIGKILL)
        self.until("lost", name)
        return time.monotonic() - begun

    def kill_node_and_wait(self, name: str, pid: int) -> None:
        """Kill a node, and wait until it runs again."""
        os.kill(pid, signal.SIGKILL)
        assert wait_until(lambda: self.pids[name] != pid, LIMIT_S), "\n".join(self.lines)

    def interrupt(self, number: signal.Signals = signal.SIGINT) -> float:
        """Send a signal; returns how long the run took to end."""
        begun = time.monotonic()
        self.process.send_signal(number)
        self.wait()
        return time.monotonic() - begun

    def wait(self) -> int:
        """Wait for the end; returns the exit code."""
        assert wait_until(lambda: self.process.poll() is not None, LIMIT_S), "\n".join(self.lines)
        self._reading.join()
        return self.process.wait()

    @property
    def error(self) -> str:
        """The last line, which says what went wrong."""
        return self.lines[-1]

    @property
    def left(self) -> list[int]:
        """Processes of the run that still live."""
        return children_of(str(self.graph))

    def kill(self) -> None:
        """End what is left of it, whatever the test made of it."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for number in self.left:
            os.kill(number, signal.SIGKILL)
