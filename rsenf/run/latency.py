"""How late a node's inputs are: median and slowest twentieth of the last minute."""

from __future__ import annotations

import math
import threading
from collections import deque

MINUTE_S = 60.0
MOST = 2048  # frames at 30 Hz, and more of anything slower
NONE = (math.nan, math.nan)


class LastMinute:
    """Latencies of the last minute. May be used from several threads."""

    def __init__(self) -> None:
        self._taken: deque[tuple[float, float]] = deque(maxlen=MOST)
        self._lock = threading.Lock()

    def note(self, now_s: float, latency_s: float) -> None:
        """Take one in, at a time by any steady clock."""
        with self._lock:
            self._taken.append((now_s, latency_s))

    def p50_p95_s(self, now_s: float) -> tuple[float, float]:
        """Return both; NaN when there was none."""
        with self._lock:
            while self._taken and now_s - self._taken[0][0] > MINUTE_S:
                self._taken.popleft()
            values = sorted(latency for _, latency in self._taken)
        if not values:
            return NONE
        return values[(len(values) - 1) // 2], values[math.ceil(0.95 * len(values)) - 1]
