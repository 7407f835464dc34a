"""Time limits that hold on a slow or busy machine too: as it starts processes, so it does all."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable

# What a node imports, and how long a process takes for it where nothing else runs.
NODE, START_S = "import rsenf.run.node", 0.5
PAUSE_S = 0.02


def slowness() -> float:
    """How many times longer a process takes to start now than on an idle machine; 1 at least."""
    begun_s = time.monotonic()
    subprocess.run([sys.executable, "-c", NODE], check=True)
    return max(1.0, (time.monotonic() - begun_s) / START_S)


class Patience:
    """A time limit that is measured out anew once it is over: only who runs into it pays for that.

    Parameters
    ----------
    limit_s : float
        On an idle machine.
    """

    def __init__(self, limit_s: float) -> None:
        self._idle_s = limit_s
        self._begun_s = time.monotonic()
        self._end_s = self._begun_s + limit_s

    @property
    def left_s(self) -> float:
        """What is left of it, as far as is known before it is over."""
        return self._end_s - time.monotonic()

    @property
    def over(self) -> bool:
        """Whether it is over even for a machine that is as slow as this one is now."""
        if self.left_s <= 0:
            self._end_s = max(self._end_s, self._begun_s + self._idle_s * slowness())
        return self.left_s <= 0


def wait_until(reached: Callable[[], bool], limit_s: float = 20.0) -> bool:
    """Wait for a condition as long as an idle machine may take, or this one; tell if it came."""
    patience = Patience(limit_s)
    while not reached():
        if patience.over:
            return reached()  # to know that it is over takes a while
        time.sleep(PAUSE_S)
    return True
