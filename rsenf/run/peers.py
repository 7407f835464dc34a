"""Which other nodes of the graph are present: by liveliness tokens and last health messages."""

from __future__ import annotations

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterable

from rsenf.bus.keys import node_of

# A node that reports 'done' and withdraws its token has finished; one whose token vanishes without
# such a report is lost. The report may arrive a moment after the token has gone.
LAST_WORD_S = 1.0
LAST_WORDS = ("done", "failed")
# What the supervisor reports of a node that it won't, or can't, restart.
GIVEN_UP = "lost"


class Peers:
    """Presence of the other nodes. Thread-safe.

    Parameters
    ----------
    names : set of str
        The other nodes.
    returning : iterable of str
        Those that are restarted when they die, or whose link may come back.
    gone : iterable of str
        Those that had ended before this node began.
    """

    def __init__(
        self, names: set[str], returning: Iterable[str] = (), gone: Iterable[str] = ()
    ) -> None:
        self.names = names
        self._returning = set(returning)
        self._alive: set[str] = set()
        self._gone_since = dict.fromkeys(gone, time.monotonic())
        self._departures: Counter[str] = Counter()
        # What was last said of each since it was last started: of LAST_WORDS, and GIVEN_UP.
        self._last_words = defaultdict[str, set[str]](set, {name: {GIVEN_UP} for name in gone})
        self._change = threading.Condition()

    def on_alive(self, key: str, alive: bool) -> None:
        """Note that a token appeared or vanished."""
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
        """Note a state that a node, or its supervisor, reported."""
        with self._change:
            if state in LAST_WORDS or state == GIVEN_UP:
                self._last_words[name].add(state)
                if name not in self._alive:  # failed before it was ready, so there was no token
                    self._gone_since.setdefault(name, time.monotonic())
            else:
                if state == "restarting":
                    self._returning.add(name)
                # It was restarted. Its token can't tell this: it may come after the last message.
                self._last_words[name].clear()
            self._change.notify_all()

    def wait_for(self, names: set[str], timeout_s: float, stop: threading.Event) -> set[str]:
        """Wait until nodes have been seen; return those that have not.

        Parameters
        ----------
        names : set of str
        timeout_s : float
            May be infinite.
        stop : Event
            Ends the wait.
        """
        deadline = time.monotonic() + timeout_s
        with self._change:
            while (missing := names & self.missing) and not stop.is_set():
                remaining_s = deadline - time.monotonic()
                if remaining_s <= 0:
                    break
                self._change.wait(min(remaining_s, 0.2))
            return missing

    @property
    def missing(self) -> set[str]:
        """Nodes that have never been seen or reported."""
        return self.names - self._alive - set(self._gone_since)

    @property
    def lost(self) -> tuple[str, ...]:
        """Nodes whose token vanished without a last health message."""
        now = time.monotonic()
        with self._change:
            return tuple(
                sorted(
                    name
                    for name, since in self._gone_since.items()
                    if self._last_words[name].isdisjoint(LAST_WORDS) and now - since > LAST_WORD_S
                )
            )

    def is_awaited(self, name: str) -> bool:
        """Whether a node is away, and may come back."""
        with self._change:
            # After 'failed' the supervisor decides whether that is final.
            is_final = not self._last_words[name].isdisjoint(("done", GIVEN_UP))
            return name in self._gone_since and name in self._returning and not is_final

    def needs(self, name: str, only_until_back: bool) -> bool:
        """Whether a node that was restarted, or may be, may need what others have kept.

        One that hangs is restarted, too: then it needs what it has received as well.
        """
        with self._change:
            if name in self._gone_since or only_until_back:
                return self.is_awaited(name)
            return self._departures[name] > 0 or name in self._returning & self._alive

    def gone_for_s(self, name: str) -> float:
        """Seconds since a node went for whatever reason; 0 while it is there or may come back."""
        with self._change:
            since = self._gone_since.get(name)
            return 0.0 if since is None or self.is_awaited(name) else time.monotonic() - since

    def has_finished(self, name: str) -> bool:
        """Whether a node ended with 'done', so that all its messages have been sent."""
        with self._change:
            return "done" in self._last_words[name]

    def departures(self, name: str) -> tuple[int, bool]:
        """Return how often a node has gone, and whether it is away now."""
        with self._change:
            return self._departures[name], name in self._gone_since
