"""Who is on a bus, by tokens and words of health, and how each is doing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from rsenf.bus.bus import Bus
from rsenf.bus.delivery import LOOKING
from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import alive_key, health_key, node_of, site_of
from rsenf.messages import Health
from rsenf.messages.plain import plain
from rsenf.run.peers import LAST_WORDS

# A node says something every second: after this long it is silent.
SILENT_S = 3.5
UP = ("running", "done")


@dataclass
class Seen:
    """What was seen of a node.

    Attributes
    ----------
    alive : bool
        Whether its token is there.
    health : Health or None
        Its last word, or its supervisor's about it.
    heard_s : float
        When that came, by the roster's clock.
    """

    site: str
    name: str
    alive: bool = False
    health: Health | None = None
    heard_s: float = 0.0

    def state(self, now_s: float) -> str:
        """'silent' for a token without words, 'lost' for words without a token, or what it says."""
        if self.health is None:
            return "silent" if self.alive else "absent"
        if self.alive and now_s - self.heard_s > SILENT_S:
            return "silent"
        ended = self.health.state in (*LAST_WORDS, "lost", "restarting", "starting")
        return self.health.state if self.alive or ended else "lost"


class Roster:
    """Watches the nodes of a bus. To be filled by :meth:`listen`, from one thread.

    Parameters
    ----------
    bus : Bus
        An open bus.
    site : str
        Site to look at; ``*`` for all.
    clock : callable, optional
        A steady clock, in seconds.
    """

    def __init__(self, bus: Bus, site: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: dict[tuple[str, str], Seen] = {}
        self._words = Inbox()
        bus.watch_alive(alive_key(site, "*"), self._on_alive)
        bus.subscribe(self._words, health_key(site, "*"), LOOKING)

    def expect(self, site: str, names: Iterable[str]) -> None:
        """Name nodes that should be there."""
        for name in names:
            self._of(site, name)

    def listen(self, timeout_s: float) -> bool:
        """Take in the next word; False when none came in time."""
        received = self._words.receive(timeout_s)
        if received is None:
            return False
        seen = self._of(site_of(received.key), node_of(received.key))
        # Its supervisor speaks of it too, and what was kept of that may be old.
        if seen.health is None or received.message.time_ns >= seen.health.time_ns:
            seen.health, seen.heard_s = received.message, self._clock()
        return True

    def nodes(self) -> list[Seen]:
        """Return all that were seen, or expected, by name."""
        return [self._seen[at] for at in sorted(self._seen.copy())]

    def down(self) -> list[str]:
        """Return which nodes neither run nor have done their work, in words."""
        states = {f"{s.site}/{s.name}": s.state(self._clock()) for s in self.nodes()}
        none = {"any node": "absent"}
        return [f"{name} is {state}" for name, state in (states or none).items() if state not in UP]

    def as_json(self) -> list[dict[str, Any]]:
        """Return all that is known of them as plain data."""
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
