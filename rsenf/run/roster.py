"""What is on a bus: the nodes and their states, and the message and data rates of the topics.

Nodes are known by their liveliness tokens and health messages.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rsenf.bus.bus import Bus
from rsenf.bus.inbox import Inbox, Received
from rsenf.bus.keys import LOOKING, SILENT_S, Delivery, alive_key, health_key, node_of, site_of
from rsenf.messages import Health
from rsenf.messages.codec import plain
from rsenf.run.peers import LAST_WORDS

UP = ("running", "done")


@dataclass
class Seen:
    """What is known of a node.

    Attributes
    ----------
    alive : bool
        Whether its liveliness token is present.
    health : Health or None
        Its last health message, or its supervisor's about it.
    heard_s : float
        When that arrived, by the roster's clock.
    """

    site: str
    name: str
    alive: bool = False
    health: Health | None = None
    heard_s: float = 0.0

    def state(self, now_s: float) -> str:
        """Return its state.

        'absent' without token and health, 'silent' for a token without (recent) health, 'lost' for
        health of a node that should run but has no token; else as its health says.
        """
        if self.health is None:
            return "silent" if self.alive else "absent"
        if self.alive and now_s - self.heard_s > SILENT_S:
            return "silent"
        ended = self.health.state in (*LAST_WORDS, "lost", "restarting", "starting")
        return self.health.state if self.alive or ended else "lost"


class Roster:
    """Observes the nodes of a bus. Call :meth:`listen` repeatedly, from one thread.

    Parameters
    ----------
    bus : Bus
        An open bus.
    site : str
        Site to observe; ``*`` for all.
    clock : callable, optional
        A monotonic clock, in seconds.
    """

    def __init__(self, bus: Bus, site: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[tuple[str, str], Seen] = {}
        self._words = Inbox()
        bus.watch_alive(alive_key(site, "*"), self._on_alive)
        bus.subscribe(self._words, health_key(site, "*"), LOOKING)

    def expect(self, site: str, names: Iterable[str]) -> None:
        """Add nodes that should be present."""
        for name in names:
            self._of(site, name)

    def listen(self, timeout_s: float) -> bool:
        """Take the next health message; return False when none came in time."""
        received = self._words.receive(timeout_s)
        if received is None:
            return False
        seen = self._of(site_of(received.key), node_of(received.key))
        # Its supervisor reports on it too, and such a message from the history may be older.
        if seen.health is None or received.message.time_ns >= seen.health.time_ns:
            seen.health, seen.heard_s = received.message, self._clock()
        return True

    def nodes(self) -> list[Seen]:
        """Return all nodes seen or expected, sorted by site and name."""
        return [self._seen[at] for at in sorted(self._seen.copy())]

    def down(self) -> list[str]:
        """Return the nodes that are neither running nor done, and their states, in words."""
        states = {f"{s.site}/{s.name}": s.state(self._clock()) for s in self.nodes()}
        none = {"any node": "absent"}
        return [f"{name} is {state}" for name, state in (states or none).items() if state not in UP]

    def as_json(self) -> list[dict[str, Any]]:
        """Return all nodes as plain data."""
        now_s = self._clock()
        return [
            {"site": seen.site, "node": seen.name, "alive": seen.alive}
            | (plain(seen.health) if seen.health else {})
            | {"state": seen.state(now_s)}
            for seen in self.nodes()
        ]

    def _of(self, site: str, name: str) -> Seen:
        return self._seen.setdefault((site, name), Seen(site, name))

    def _on_alive(self, key: str, alive: bool) -> None:
        self._of(site_of(key), node_of(key)).alive = alive


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
