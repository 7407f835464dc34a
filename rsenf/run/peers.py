"""Who else of the graph is there: liveliness tokens, and the last word of each node's health."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable

from rsenf.bus.keys import node_of

# A node that says 'done' and withdraws its token has finished; one whose token vanishes without
# a word was lost. The word may come a moment after the token has gone.
LAST_WORD_S = 1.0
LAST_WORDS = ("done", "failed")
# What the supervisor says of a node that it won't start again, or never could.
GIVEN_UP = "lost"


class Peers:
    """Thread-safe picture of the other nodes.

    Parameters
    ----------
    names : set of str
        Who they are.
    returning : set of str
        Those that are started again when they die, or whose link may come back.
    gone : sequence of str
        Those that had ended before this node began.
    """

    def __init__(
        self, names: set[str], returning: Iterable[str] = (), gone: Iterable[str] = ()
    ) -> None:
        self.names = names
        self._returning = set(returning)
        self._alive: set[str] = set()
        self._gone_since = dict.fromkeys(gone, time.monotonic())
        self._final = set(gone)
        self._departures: Counter[str] = Counter()
        self._finished: set[str] = set()
        self._done: set[str] = set()  # of those, who hasn't failed
        self._change = threading.Condition()

    def on_alive(self, key: str, alive: bool) -> None:
        """Take in that a token appeared or vanished."""
        name = node_of(key)
        with self._change:
            if alive:
                self._alive.add(name)
                self._gone_since.pop(name, None)
            elif name in self._alive:
                self._alive.discard(name)
                self._departures[name] += 1
                self._gone_since[name] = time.monotonic()
            self._change.notify_all()

    def on_state(self, name: str, state: str) -> None:
        """Take in what a node says of itself."""
        with self._change:
            if state in LAST_WORDS or state == GIVEN_UP:
                if state != GIVEN_UP:
                    self._finished.add(name)
                if state == "done":
                    self._done.add(name)
                if state != "failed":  # that is for the supervisor to say
                    self._final.add(name)
                if name not in self._alive:  # failed before it was ready, so there was no token
                    self._gone_since.setdefault(name, time.monotonic())
            else:
                # Another life of it. Its token doesn't tell: it may come after the last word.
                for ended in (self._finished, self._done, self._final):
                    ended.discard(name)
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
        """Seconds since a node went, however; 0 while it is there, or may come back."""
        with self._change:
            since = self._gone_since.get(name)
            comes_back = name in self._returning - self._final
        return 0.0 if since is None or comes_back else time.monotonic() - since

    def has_finished(self, name: str) -> bool:
        """Whether a node has ended well: what it had to send is sent."""
        with self._change:
            return name in self._done

    def departures(self, name: str) -> tuple[int, bool]:
        """How often a node has gone, and whether it is away now."""
        with self._change:
            return self._departures[name], name in self._gone_since
