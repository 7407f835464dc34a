"""A live source with reconnection: each connection is a new epoch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Protocol

from rsenf.decode.pump import Disconnected, Pump, Stop, Stopped
from rsenf.decode.source import Item, SourceSpec, Stamp, StreamInfo, VideoSource
from rsenf.errors import SourceLost
from rsenf.timebase import NS_PER_S


class Connection(Protocol):
    """One connection to a live source."""

    info: StreamInfo
    pump: Pump[Any]

    def items(self) -> Iterator[Item]:
        """Yield packets and frames.

        Raises
        ------
        Disconnected
            When the source is lost.
        Stopped
            When asked to stop.
        """

    @property
    def damaged(self) -> int:
        """Frames and packets that could not be used."""

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result, one line each."""

    def close(self) -> None:
        """Close the connection, without waiting."""


class LiveSource(VideoSource):
    """Keeps a connection to a camera; reconnects with exponential backoff.

    Parameters
    ----------
    spec, stamp, stop : SourceSpec, Stamp, Stop
        As for every source.
    connect : callable
        Takes the epoch, returns a :class:`Connection` whose first frame has been decoded. Raises
        Disconnected or Stopped.
    on_event : callable
        Called with one line of text when the source is lost, before each further attempt, and when
        it is back.

    Raises
    ------
    SourceLost
        When the first connection fails, unless ``spec.wait_for_source`` is set: then the first
        connection is made, and repeated, during iteration. While iterating, after
        ``spec.max_reconnects`` failed attempts.
    """

    def __init__(
        self,
        spec: SourceSpec,
        stamp: Stamp,
        stop: Stop,
        connect: Callable[[int], Connection],
        on_event: Callable[[str], None],
    ) -> None:
        super().__init__(stamp, stop)
        self._spec = spec
        self._connect = connect
        self._on_event = on_event
        self._epoch = 0
        self._reasons: list[str] = []  # why each connection was lost
        self._damaged = self._overrun = 0
        self._warnings: list[str] = []
        self._there_ns = stamp.steady_ns()  # time of its last item
        self.info = StreamInfo(live=True)  # until the first connection
        self._connection = None if spec.wait_for_source else self._first_connection()

    def _first_connection(self) -> Connection | None:
        try:
            return self._attempt()
        except Disconnected as exc:
            if self._spec.wait_for_source:
                return self._reconnect(exc)
            raise self._lost(exc) from exc
        except Stopped:
            return None

    def _attempt(self) -> Connection:
        connection = self._connect(self._epoch)
        self.info = connection.info
        return connection

    def _lost(self, why: Disconnected) -> SourceLost:
        hint = why.hint or "check the address, the camera and the network"
        return SourceLost(f"{self._spec.name}: {why.reason}", hint)

    def _reconnect(self, why: Disconnected) -> Connection | None:
        """Try until it succeeds; return None when stopped."""
        backoff_s, attempts = self._spec.backoff_initial_s, 0
        while True:
            if self._spec.max_reconnects is not None and attempts >= self._spec.max_reconnects:
                raise self._lost(why) from why
            self._on_event(f"{self._spec.name}: {why.reason}; next attempt in {backoff_s:g} s")
            if self._stop.wait(backoff_s):
                return None
            attempts += 1
            try:
                connection = self._attempt()
            except Disconnected as exc:
                why, backoff_s = exc, min(2 * backoff_s, self._spec.backoff_max_s)
            except Stopped:
                return None
            else:
                away_s = (self._stamp.steady_ns() - self._there_ns) / NS_PER_S
                self._on_event(f"{self._spec.name}: connected; it was away for {away_s:.1f} s")
                return connection

    def _items(self) -> Iterator[Item]:
        if self._spec.wait_for_source:
            self._connection = self._first_connection()
        while self._connection is not None:
            connection = self._connection
            try:
                for item in connection.items():
                    self._there_ns = self._stamp.steady_ns()
                    yield item
            except Stopped:
                return
            except Disconnected as exc:
                why = exc
            finally:
                self._connection = None
                connection.close()
                self._damaged += connection.damaged
                self._overrun += connection.pump.overrun
                self._warnings = connection.warnings
            self._reasons.append(why.reason)
            self._epoch += 1
            self._connection = self._reconnect(why)

    @property
    def loss(self) -> str:
        """What was lost until now, in one line; empty for nothing."""
        lost = []
        if self._reasons:
            times = "once" if len(self._reasons) == 1 else f"{len(self._reasons)} times, last"
            lost.append(f"lost the source {times}: {self._reasons[-1]}")
        if self._damaged:
            lost.append(f"damaged frames and packets: {self._damaged}")
        if dropped := self.backlog[1]:
            lost.append(f"pictures dropped for lack of time: {dropped}")
        return "; ".join(lost)

    @property
    def backlog(self) -> tuple[int, int]:
        """Pictures that wait for the consumer, and those dropped because it was too slow."""
        pump = self._connection.pump if self._connection else None
        return (pump.waiting, self._overrun + pump.overrun) if pump else (0, self._overrun)

    @property
    def warnings(self) -> list[str]:
        """Warnings that belong in a result though nothing was lost, one line each."""
        return self._warnings
