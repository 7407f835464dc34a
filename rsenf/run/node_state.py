"""State of a node in its supervisor."""

from __future__ import annotations

import signal
import subprocess
from dataclasses import dataclass

from rsenf.messages import Health

WENT_WRONG = ("lost", "failed")
HANGS = ("silent", "stalled")


@dataclass
class NodeState:
    """State of a node.

    Attributes
    ----------
    state : str
        As its health says: 'starting', 'waiting', 'running', 'done' or 'failed'; 'lost' when its
        process ended without saying so; 'restarting' when a restart is due; 'silent' without
        health, 'stalled' without progress though messages wait.
    restarts : int
        Number of restarts.
    """

    name: str
    kind: str
    state: str = "starting"
    detail: str = ""
    health: Health | None = None
    process: subprocess.Popen[bytes] | None = None
    exit_code: int | None = None
    told: bool = False  # whether SIGTERM was sent
    was_ready: bool = False
    restarts: int = 0

    @property
    def went_wrong(self) -> bool:
        """Whether it failed or was lost."""
        return self.state in WENT_WRONG

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to its process, unless it has ended."""
        if self.process and self.exit_code is None:
            self.process.send_signal(number)


def end_of(node: NodeState, code: int) -> tuple[str, str]:
    """Return the state and detail of a node whose process has ended.

    Parameters
    ----------
    node : NodeState
        As it was before.
    code : int
        Exit code; below 0 the negative number of the signal that killed it.
    """
    if node.state == "failed" or (node.state == "done" and code >= 0):
        return node.state, node.detail
    if code == -signal.SIGTERM and node.told:  # before its signal handler was installed
        return "done", "stopped before it began"
    if code == -signal.SIGKILL and node.told:
        return "failed", "did not stop in time and was killed"
    if code < 0:
        return "lost", f"killed by signal {-code}"
    return ("failed", f"exit code {code}") if code else ("done", node.detail)
