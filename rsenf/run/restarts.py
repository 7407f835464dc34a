"""When a node that died is started again: after a growing pause, so many times within so long."""

from __future__ import annotations

from collections import deque

from rsenf.config.node_kind import Restart
from rsenf.errors import EXIT_USAGE

# Until its first word a node may take this long: it loads libraries, on a machine that is busy.
FIRST_WORD_S = 60.0


class Restarts:
    """Restarts of one node.

    Parameters
    ----------
    rule : Restart, optional
        The rule; without, a node is never started again.
    """

    def __init__(self, rule: Restart | None) -> None:
        self.rule = rule
        self.count = 0
        self._deaths: deque[float] = deque()

    def pause_s(self, now_s: float, exit_code: int) -> float | None:
        """Take in a death; return the pause until it is started again, or None when it isn't.

        Parameters
        ----------
        now_s : float
            Time of the death by a steady clock.
        exit_code : int
            What is wrongly set up stays so, however often it is tried.
        """
        if self.rule is None or exit_code == EXIT_USAGE:
            return None
        while self._deaths and now_s - self._deaths[0] > self.rule.within_s:
            self._deaths.popleft()
        if len(self._deaths) >= self.rule.limit:
            return None
        pause_s = self.rule.backoff_s * 2.0 ** min(len(self._deaths), 30)
        self._deaths.append(now_s)
        self.count += 1
        return float(min(pause_s, self.rule.backoff_max_s))

    def of(self) -> str:
        """Which one this is, of how many, in words."""
        assert self.rule is not None
        return f"{len(self._deaths)} of {self.rule.limit} within {self.rule.within_s:g} s"
