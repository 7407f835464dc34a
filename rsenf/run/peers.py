"""Who else of the graph is there: liveliness tokens, and the last word of each node's health."""

from __future__ import annotations

import threading
import time

from rsenf.bus.keys import node_of

# A node that says 'done' and withdraws its token has finished; one whose token vanishes without
# a word was lost. The word may come a moment after the token has gone.
LAST_WORD_S = 0.6
LAST_WORDS = ("done", "failed")


class Peers:
    """Thread-safe picture of the other nodes.

    Parameters
    ----------
    names : set of str
        Who they are.
    elsewhere : set of str
        Who of them runs on another host: it may be the link that is gone, and come back.
    """

    def __init__(self, names: set[str], elsewhere: set[str] | None = None) -> None:
        self.names, self.elsewhere = names, elsewhere or set()
        self._alive: set[str] = set()
        self._gone_since: dict[str, float] = {}
        self._finished: set[str] = set()
        self._change = threading.Condition()

    def on_alive(self, key: str, alive: bool) -> None:
        """Take in that a token appeared or vanished."""
        name = node_of(key)
        with self._change:
            if alive:
                self._alive.add(name)
                self._gone_since.pop(name, None)
                self._finished.discard(name)
            elif name in self._alive:
                self._alive.discard(name)
                self._gone_since[name] = time.monotonic()
            self._change.notify_all()

    def on_state(self, name: str, state: str) -> None:
        """Take in what a node says of itself."""
        with self._change:
            if state in LAST_WORDS:
                self._finished.add(name)
                if name not in self._alive:  # failed before it was ready, so there was no token
                    self._gone_since.setdefault(name, time.monotonic())
            self._change.notify_all()

    def wait_for(self, names: set[str], timeout_s: float, stop: threading.Event) -> set[str]:
        """Wait until these nodes have been seen; returns those that have not."""
        deadline = time.monotonic() + timeout_s
        with self._change:
            while (missing := names & self.missing) and not stop.is_set():
                left = deadline - time.monotonic()
                if left <= 0:
                    break
                self._change.wait(min(left, 0.2))
            return missing

    @property
    def missing(self) -> set[str]:
        """Nodes that have never been seen, nor heard of."""
        return self.names - self._alive - set(self._gone_since)

    @property
    def lost(self) -> tuple[str, ...]:
        """Nodes that vanished without a word."""
        now = time.monotonic()
        with self._change:
            return tuple(
                sorted(
                    name
                    for name, since in self._gone_since.items()
                    if name not in self._finished and now - since > LAST_WORD_S
                )
            )

    def gone_for_s(self, name: str) -> float:
        """Seconds since a node's token vanished, however it went; 0 while it is there.

        One of another host isn't gone before it has said so.
        """
        with self._change:
            since = self._gone_since.get(name)
            if name in self.elsewhere - self._finished:
                return 0.0
        return 0.0 if since is None else time.monotonic() - since
