"""A node as its supervisor knows it."""

from __future__ import annotations

import signal
import subprocess
from dataclasses import dataclass

from rsenf.messages import Health

WENT_WRONG = ("lost", "failed")


@dataclass
class NodeState:
    """What is known of a node.

    Attributes
    ----------
    state : str
        'starting', 'running', 'done', 'failed', 'lost' when its process ended without a word, or
        'restarting' when it is to be started again.
    restarts : int
        Times it was started again.
    """

    name: str
    kind: str
    state: str = "starting"
    detail: str = ""
    health: Health | None = None
    process: subprocess.Popen[bytes] | None = None
    exit_code: int | None = None
    told: bool = False  # to stop
    was_ready: bool = False
    restarts: int = 0

    @property
    def went_wrong(self) -> bool:
        """Whether it failed or was lost."""
        return self.state in WENT_WRONG

    def signal(self, number: signal.Signals) -> None:
        """Send its process a signal, unless it has ended."""
        if self.process and self.exit_code is None:
            self.process.send_signal(number)


def end_of(node: NodeState, code: int) -> tuple[str, str]:
    """Return the state and detail of a node whose process has ended with a code."""
    if node.state == "failed" or (node.state == "done" and code >= 0):
        return node.state, node.detail
    if code == -signal.SIGTERM and node.told:  # before it could listen to signals
        return "done", "stopped before it began"
    if code == -signal.SIGKILL and node.told:
        return "failed", "did not stop in time and was killed"
    if code < 0:
        return "lost", f"killed by signal {-code}"
    return ("failed", f"exit code {code}") if code else ("done", node.detail)
