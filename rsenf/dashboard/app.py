"""The ASGI application: static files, updates by WebSocket, pictures and recordings.

A browser is sent only what has changed since its last update (:class:`Session`).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections import deque
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from rsenf.dashboard.enf_series import KEPT, RECENT
from rsenf.dashboard.site import Site, file_named, files_about, state_of
from rsenf.errors import UsageError

VERSION = 1
UNSEEN = (0, 0)
SILENCE_NS = 5_000_000_000  # after which an empty update is sent as a keep-alive


class Session:
    """One connection of a browser: the first update is complete, later ones hold the changes.

    Parameters
    ----------
    site : Site
    """

    def __init__(self, site: Site) -> None:
        self._site = site
        self._sent: dict[str, str] = {}
        self._watched, self._series = "", RECENT
        self._seen = {"strip": UNSEEN, "spectrogram": UNSEEN}
        # Filled in one thread, read in another.
        self._asked: deque[str] = deque(maxlen=1)
        self._sent_ns = 0

    def ask(self, text: str) -> None:
        """Select the feed to be shown in full: ``{"feed": NAME, "series": "recent"}``."""
        self._asked.append(text)

    def _turn_to(self, text: str) -> None:
        """Switch to the feed that is asked for; an invalid request is ignored."""
        try:
            asked = json.loads(text)
            name, series = str(asked["feed"]), str(asked.get("series", RECENT))
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return
        if name != self._watched:
            self._seen = dict.fromkeys(self._seen, UNSEEN)
        self._watched, self._series = name, series if series in KEPT else RECENT
        self._sent.pop("chart", None)

    def news(self) -> str:
        """Return what has changed since the last call, as JSON.

        Empty if nothing has, except for a keep-alive after SILENCE_NS.
        """
        site = self._site
        while self._asked:
            self._turn_to(self._asked.pop())
        with site.lock:
            fresh = self._changed("card/", {n: site.card(n) for n in site.feed_names})
            parts = {
                "cards": list(fresh.values()),
                **self._changed("", self._boards()),
                **self._detail(),
            }
        parts = {name: part for name, part in parts.items() if part != []}
        now_ns = site.clock_ns()
        if not parts and 0 <= now_ns - self._sent_ns < SILENCE_NS:
            return ""
        self._sent_ns = now_ns
        update = {"version": VERSION, "now_ms": now_ns // 1_000_000, **parts}
        return json.dumps(update, allow_nan=False, separators=(",", ":"))

    def _boards(self) -> dict[str, Any]:
        site = self._site
        return {
            "nodes": {"list": site.nodes.plain(site.clock_ns())},
            "alarms": {"list": site.alarms.plain(), "unwritten": site.alarms.log.unwritten},
            "site": {
                "feeds": site.feed_names,
                "left_out": site.feeds_left_out > 0,
                "has_archive": site.wiring.archive is not None,
            },
        }

    def _detail(self) -> dict[str, Any]:
        """Return the changes of the feed that is shown in full."""
        feed = self._site.feed(self._watched)
        if feed is None:
            return {}
        found = self._changed("", {"chart": {"feed": feed.name, **feed.chart(self._series)}})
        pictures = {
            "strip": (feed.strip.columns.seen, feed.strip_plain),
            "spectrogram": (feed.spectrogram.columns.seen, feed.spectrogram_plain),
        }
        for name, (there, plain) in pictures.items():
            if there != self._seen[name]:
                found[name] = {"feed": feed.name, **plain(self._seen[name])}
                self._seen[name] = there
        return found

    def _changed(self, prefix: str, parts: dict[str, Any]) -> dict[str, Any]:
        """Return the parts that differ from those sent last."""
        fresh = {}
        for name, part in parts.items():
            text = json.dumps(part, allow_nan=False)
            if self._sent.get(prefix + name) != text:
                self._sent[prefix + name] = text
                fresh[name] = part
        return fresh


if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

STATIC = Path(__file__).with_name("static")
EVERY_S = 0.5
LEAST_S = 0.05  # shortest time between two updates, however fast a browser asks
MOST_BROWSERS = 64
LARGEST_QUESTION = 1000
LARGEST_BODY = 5000
LONGEST_NAME, LONGEST_NOTE = 64, 500


def make_app(site: Site, stop: Event) -> Starlette:
    """Make the ASGI application.

    Parameters
    ----------
    site : Site
    stop : Event
        Closes the WebSockets when set.

    Raises
    ------
    UsageError
        When a required package isn't installed.
    """
    try:
        from starlette.applications import Starlette
        from starlette.routing import Mount, Route, WebSocketRoute
        from starlette.staticfiles import StaticFiles
    except ImportError as exc:
        raise missing(exc) from exc
    pages = _Pages(site, stop)
    routes = [
        Route("/pictures/{feed:path}.jpg", pages.picture),
        Route("/alarms/{number:int}/recordings", pages.about_alarm),
        Route("/alarms/{number:int}/acknowledgement", pages.acknowledge, methods=["POST"]),
        Route("/history", pages.history),
        Route("/recordings/{name:path}", pages.recording),
        WebSocketRoute("/news", pages.news),
        Mount("/", StaticFiles(directory=STATIC, html=True)),
    ]
    return Starlette(routes=routes)


def missing(exc: ImportError) -> UsageError:
    """Return the error for a package that isn't installed."""
    return UsageError(
        f"the dashboard needs the package {exc.name}", "pip install 'rsenf[dashboard]'"
    )


def _one_line(text: str, longest: int) -> str:
    """Return a text without control characters, cut to a length."""
    return "".join(c for c in text if c.isprintable()).strip()[:longest]


async def _body(request: Request) -> bytes:
    """Return a request's body; ValueError when it is too long."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > LARGEST_BODY:
            raise ValueError("too long")
    return body


class _Pages:
    """Handlers of the routes that aren't static files."""

    def __init__(self, site: Site, stop: Event) -> None:
        self._site, self._stop = site, stop
        self._browsers = 0

    async def picture(self, request: Request) -> Response:
        from starlette.responses import Response

        jpeg = self._site.picture(request.path_params["feed"])
        return Response(jpeg, 200 if jpeg else 404, media_type="image/jpeg")

    async def about_alarm(self, request: Request) -> Response:
        from starlette.responses import JSONResponse

        archive, raised = self._site.wiring.archive, self._site.alarm(request.path_params["number"])
        if raised is None:
            return JSONResponse({"files": []}, 404)
        files = await asyncio.to_thread(files_about, archive, raised) if archive else []
        return JSONResponse({"files": files})

    async def acknowledge(self, request: Request) -> Response:
        """Take ``{"by": NAME, "note": TEXT}``."""
        from starlette.responses import Response

        def answer(text: str, status: int) -> Response:
            return Response(text, status, media_type="text/plain")

        # A page of another site can't send this type without asking first.
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            return answer("JSON only\n", 415)
        try:
            body = await _body(request)
            said = json.loads(body)
            by = _one_line(said["by"], LONGEST_NAME)
            note = _one_line(said.get("note", ""), LONGEST_NOTE)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            by = ""
        if not by:
            return answer('want {"by": NAME, "note": TEXT}\n', 400)
        number = request.path_params["number"]
        try:
            known = await asyncio.to_thread(self._site.acknowledge, number, by, note)
        except OSError as exc:
            return answer(f"it can't be kept: {exc.strerror}\n", 507)
        return answer("", 204) if known else answer("no such alarm\n", 404)

    async def history(self, request: Request) -> Response:
        from starlette.responses import JSONResponse

        log = self._site.alarms.log
        return JSONResponse(await asyncio.to_thread(log.day, request.query_params.get("day", "")))

    async def recording(self, request: Request) -> Response:
        from starlette.responses import FileResponse, Response

        archive, name = self._site.wiring.archive, request.path_params["name"]
        path = await asyncio.to_thread(file_named, archive, name) if archive else None
        if path is None or not path.is_file():
            return Response("no such recording\n", 404, media_type="text/plain")
        answer = FileResponse(
            path, filename=path.name, media_type="application/octet-stream", stat_result=path.stat()
        )
        if not state_of(path)[1]:  # the file grows while it is sent: its final size is unknown
            del answer.headers["content-length"]
        return answer

    async def news(self, socket: WebSocket) -> None:
        if self._browsers >= MOST_BROWSERS:
            await socket.close(1013)
            return
        self._browsers += 1
        try:
            await self._tell(socket)
        finally:
            self._browsers -= 1

    async def _tell(self, socket: WebSocket) -> None:
        from starlette.websockets import WebSocketDisconnect

        session = Session(self._site)
        await socket.accept()
        asked = asyncio.Event()

        async def listen() -> None:
            with contextlib.suppress(WebSocketDisconnect):
                while True:
                    text = await socket.receive_text()
                    if len(text) <= LARGEST_QUESTION:
                        session.ask(text)
                        asked.set()

        listening = asyncio.create_task(listen())
        try:
            while not (self._stop.is_set() or listening.done()):
                asked.clear()
                if news := await asyncio.to_thread(session.news):
                    await socket.send_text(news)
                # Answer a request almost at once; otherwise update at the regular interval.
                await asyncio.sleep(LEAST_S)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(asked.wait(), EVERY_S)
        except (WebSocketDisconnect, RuntimeError):  # disconnected while sending
            pass
        finally:
            listening.cancel()
            with contextlib.suppress(Exception):
                await socket.close(1001)
