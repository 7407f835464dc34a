"""The ASGI application: static files, updates by WebSocket, pictures and recordings.

Access is controlled by Host and Origin, against DNS rebinding and cross-site WebSockets. A browser
is sent only what has changed since its last update (:class:`Session`).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections import deque
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from rsenf.config.check import is_own_host
from rsenf.dashboard.alarm_board import file_named, files_about, state_of
from rsenf.dashboard.enf_series import KEPT, RECENT
from rsenf.dashboard.site import Site
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
            "alarms": {"list": site.alarms.plain()},
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


Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
REFUSED = b"refused: ask for this page by the address of its host\n"


class Guard:
    """Refuses requests of pages that were loaded from another site.

    With DNS rebinding, where the name of ``http://evil.example`` later resolves to 127.0.0.1, the
    header ``Host`` holds the foreign name. A WebSocket opened by a page of another site has that
    site in ``Origin`` (RFC 6455, section 10.2). Accepted hosts are IP addresses, ``localhost``,
    this host's name, and ``host``.

    Parameters
    ----------
    app : callable
        ASGI application to protect.
    host : str
        Address that the server listens at.
    """

    def __init__(self, app: App, host: str) -> None:
        self._app = app
        self._host = host

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request or refuse it."""
        if scope["type"] == "lifespan" or self._may(scope):
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            headers = [(b"content-type", b"text/plain")]
            await send({"type": "http.response.start", "status": 403, "headers": headers})
            await send({"type": "http.response.body", "body": REFUSED})

    def _may(self, scope: Scope) -> bool:
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        host, origin = headers.get("host", ""), headers.get("origin")
        return is_own_host(host, self._host) and (
            origin is None or origin.partition("://")[2].lower() == host.lower()
        )


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            extra = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            message["headers"] = [*message.get("headers", []), *extra]
        await send(message)

    return sending


if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.websockets import WebSocket

STATIC = Path(__file__).with_name("static")
EVERY_S = 0.5
LEAST_S = 0.05  # shortest time between two updates, however fast a browser asks
MOST_BROWSERS = 64
LARGEST_QUESTION = 1000


def make_app(site: Site, host: str, stop: Event) -> Guard:
    """Make the ASGI application.

    Parameters
    ----------
    site : Site
    host : str
        Address that the server listens at.
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
        Route("/recordings/{name:path}", pages.recording),
        WebSocketRoute("/news", pages.news),
        Mount("/", StaticFiles(directory=STATIC, html=True)),
    ]
    return Guard(Starlette(routes=routes), host)


def missing(exc: ImportError) -> UsageError:
    """Return the error for a package that isn't installed."""
    return UsageError(
        f"the dashboard needs the package {exc.name}", "pip install 'rsenf[dashboard]'"
    )


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
