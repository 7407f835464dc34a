"""Time limits that scale with the machine's speed, measured by the start time of a process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

# What a node imports, and how long a process takes for it on an idle machine.
NODE, START_S = "import rsenf.run.node", 0.5
PAUSE_S = 0.02


def slowness() -> float:
    """Return how many times longer a process start takes now than on an idle machine; at least 1.

    Takes as long as it measures.
    """
    begun_s = time.monotonic()
    subprocess.run([sys.executable, "-c", NODE], check=True)
    return max(1.0, (time.monotonic() - begun_s) / START_S)


class Patience:
    """A time limit that is extended by :func:`slowness`, measured only once the limit is reached.

    Parameters
    ----------
    limit_s : float
        Time limit on an idle machine.
    """

    def __init__(self, limit_s: float) -> None:
        self._idle_s = limit_s
        self._begun_s = time.monotonic()
        self._end_s = self._begun_s + limit_s

    @property
    def left_s(self) -> float:
        """Seconds left, before any extension."""
        return self._end_s - time.monotonic()

    @property
    def over(self) -> bool:
        """Whether the time is over, even for a machine as slow as this one is now."""
        if self.left_s <= 0:
            self._end_s = max(self._end_s, self._begun_s + self._idle_s * slowness())
        return self.left_s <= 0


def wait_until(reached: Callable[[], bool], limit_s: float = 20.0) -> bool:
    """Wait for a condition; return whether it was reached in time.

    Parameters
    ----------
    reached : callable
        Polled every 20 ms.
    limit_s : float
        Time limit on an idle machine; a slower one gets more, see :class:`Patience`.
    """
    patience = Patience(limit_s)
    while not reached():
        if patience.over:
            return reached()  # measuring the slowness has taken a while
        time.sleep(PAUSE_S)
    return True
