"""The headers of what is played again: another run, and an epoch for every jump."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rsenf.bus.keys import REFERENCE, TOPICS, topic_of
from rsenf.messages import Header, Mark
from rsenf.run.replay.naming import as_named


class Stamps:
    """Gives played messages their headers.

    Stages renew themselves when run or epoch of their input change. So epochs stay as they were
    recorded until something jumps; after a jump they go on above all that were used, on every
    topic alike. A second run in one recording is a jump, too: a player is one run.

    Parameters
    ----------
    run_id : str
        Of the player.
    clock_ns : callable
        Wall clock: data arrive now, not when they were recorded.
    keys : iterable of str
        All that are played.
    """

    def __init__(self, run_id: str, clock_ns: Callable[[], int], keys: Iterable[str]) -> None:
        self._run_id, self._clock_ns = run_id, clock_ns
        self._highest = -1
        self._offsets: dict[str, int] = {}  # of epochs, by recorded run
        self._joined: dict[str, tuple[str, int, int]] = {}  # where each key began since the jump
        self._last: dict[str, Header | None] = dict.fromkeys(keys)

    def jump(self) -> None:
        """What follows doesn't continue what came before."""
        self._offsets.clear()
        self._joined.clear()

    def stamp(self, key: str, message: Any) -> Any:
        """Return a message as the player sends it.

        A stream that is joined in its midst is numbered from 0; what is missing later shows.
        """
        old: Header = message.header
        place = (old.run_id, old.epoch, old.seq)
        first = self._joined.setdefault(key, place)
        seq = old.seq - first[2] if first[:2] == place[:2] else old.seq
        header = dataclasses.replace(
            old,
            run_id=self._run_id,
            epoch=old.epoch if topic_of(key) == REFERENCE else self._epoch(old),
            seq=seq,
            arrival_time_ns=self._clock_ns(),
        )
        stamped = as_named(dataclasses.replace(message, header=header), key)
        self._last[key] = stamped.header
        return stamped

    def _epoch(self, header: Header) -> int:
        offset = self._offsets.setdefault(header.run_id, self._highest + 1)
        self._highest = max(self._highest, offset + header.epoch)
        return offset + header.epoch

    def ends(self) -> Iterator[tuple[str, Any]]:
        """Yield every key's END mark."""
        for key, last in self._last.items():
            cls, seq = TOPICS[topic_of(key)], last.seq + 1 if last else 0
            header = (last or Header(run_id=self._run_id)).numbered(seq, Mark.END)
            yield key, as_named(cls(header=header), key)
