"""The ASGI application: static files, updates by WebSocket, pictures and recordings.

Access is controlled by Host and Origin, against DNS rebinding and cross-site WebSockets.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

from rsenf.dashboard.alarm_board import file_named, files_about, state_of
from rsenf.dashboard.session import Session
from rsenf.dashboard.site import Site
from rsenf.errors import UsageError

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
        self._names = {"localhost", socket.gethostname().lower(), host.lower()}

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
        return self._is_own(host) and (
            origin is None or origin.partition("://")[2].lower() == host.lower()
        )

    def _is_own(self, host: str) -> bool:
        in_brackets = host.startswith("[")
        name = host[1:].partition("]")[0] if in_brackets else host.partition(":")[0]
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return False
        return True


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
