"""Message rates and data rates of the topics on a bus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rsenf.bus.delivery import Delivery
from rsenf.bus.inbox import Received

# For measuring: no history, and no backpressure on senders.
LIVE_ONLY = Delivery(lossless=False, queue=1024, history=0)


@dataclass
class Rate:
    """Rates of one topic.

    Attributes
    ----------
    messages, bytes : int
        Received.
    longest_gap_s : float
        Longest time between two messages, or from the last to the end.
    over_s : float
        Duration of the measurement.
    """

    key: str
    message: str
    since_s: float
    messages: int = 0
    bytes: int = 0
    longest_gap_s: float = 0.0
    over_s: float = 0.0

    @property
    def rate_hz(self) -> float:
        """Messages a second."""
        return self.messages / self.over_s

    def line(self) -> tuple[str, ...]:
        """Return the cells of a table row."""
        kilobytes = self.bytes / self.over_s / 1e3
        counts = (str(self.messages), f"{self.rate_hz:.2f}", f"{kilobytes:.1f}")
        return (self.key, self.message, *counts, f"{self.longest_gap_s:.2f}")

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "topic": self.key,
            "message": self.message,
            "messages": self.messages,
            "rate_hz": self.rate_hz,
            "bytes_per_s": self.bytes / self.over_s,
            "longest_gap_s": self.longest_gap_s,
        }


class Rates:
    """Rates of all topics received.

    Parameters
    ----------
    now_s : float
        Start of the measurement, by any monotonic clock.
    """

    def __init__(self, now_s: float) -> None:
        self._begun_s = now_s
        self._rates: dict[str, Rate] = {}

    def note(self, received: Received, now_s: float) -> None:
        """Count a message."""
        name = type(received.message).__name__
        rate = self._rates.setdefault(received.key, Rate(received.key, name, self._begun_s))
        rate.messages += 1
        rate.bytes += len(received.payload)
        rate.longest_gap_s = max(rate.longest_gap_s, now_s - rate.since_s)
        rate.since_s = now_s

    def found(self, now_s: float) -> list[Rate]:
        """Return the rates until now, sorted by topic."""
        for rate in self._rates.values():
            rate.over_s = now_s - self._begun_s
            rate.longest_gap_s = max(rate.longest_gap_s, now_s - rate.since_s)
        return [self._rates[key] for key in sorted(self._rates)]
