"""A link between hosts within this one: a TCP proxy that delays, loses and can be cut.

What is lost on a real link TCP sends once more: here it comes a retransmission later. A cut link
is silent, as a pulled cable is: connections stay open, new ones get no answer.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import threading
from types import TracebackType

RESENT_AFTER_S = 0.2
CHUNK = 16 * 1024


class LinkProxy:
    """One link, from a port of its own to another.

    Parameters
    ----------
    port : int
        Where it leads to, on 127.0.0.1.
    delay_s : float
        Each way.
    loss : float
        Share of what is sent that comes a retransmission later.
    seed : int
        Of what is lost.
    """

    def __init__(self, port: int, delay_s: float = 0.0, loss: float = 0.0, seed: int = 1) -> None:
        self._to, self._delay_s, self._loss = port, delay_s, loss
        self._random = random.Random(seed)
        self._loop = asyncio.new_event_loop()
        self._whole = asyncio.Event()
        self._whole.set()
        self._open: set[asyncio.StreamWriter] = set()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="link", daemon=True)
        self.port = 0

    def __enter__(self) -> LinkProxy:
        self._thread.start()
        assert self._ready.wait(10)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._loop.call_soon_threadsafe(self._main.cancel)
        self._thread.join(10)

    def cut(self, *, ending: bool = False) -> None:
        """Let nothing through any more; or end what is open as well, as a router's end would."""
        self._loop.call_soon_threadsafe(self._whole.clear)
        if ending:
            self._loop.call_soon_threadsafe(self._end_all)

    def _end_all(self) -> None:
        for end in self._open:
            end.transport.abort()

    def mend(self) -> None:
        """Let everything through again."""
        self._loop.call_soon_threadsafe(self._whole.set)

    def _run(self) -> None:
        with (
            contextlib.suppress(asyncio.CancelledError),
            asyncio.Runner(loop_factory=lambda: self._loop) as runner,
        ):
            runner.run(self._serve())

    async def _serve(self) -> None:
        self._main = asyncio.current_task()
        server = await asyncio.start_server(self._join, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        async with server:
            await asyncio.Event().wait()

    async def _join(self, near: asyncio.StreamReader, back: asyncio.StreamWriter) -> None:
        await self._whole.wait()
        try:
            far, forth = await asyncio.open_connection("127.0.0.1", self._to)
        except OSError:
            back.close()
            return
        self._open |= {back, forth}
        ways = [asyncio.create_task(self._carry(*way)) for way in ((near, forth), (far, back))]
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in ways:
            way.cancel()
        for end in (back, forth):
            self._open.discard(end)
            end.close()

    async def _carry(self, source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
        """Carry bytes one way; many may be on their way at once, in order."""
        under_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(256)
        arriving = asyncio.create_task(self._deliver(under_way, sink))
        try:
            while data := await source.read(CHUNK):
                resent = RESENT_AFTER_S if self._random.random() < self._loss else 0.0
                await under_way.put((self._loop.time() + self._delay_s + resent, data))
        finally:
            arriving.cancel()

    async def _deliver(
        self, under_way: asyncio.Queue[tuple[float, bytes]], sink: asyncio.StreamWriter
    ) -> None:
        while True:
            due, data = await under_way.get()
            await asyncio.sleep(max(0.0, due - self._loop.time()))
            await self._whole.wait()
            sink.write(data)
            await sink.drain()
