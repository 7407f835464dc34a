"""The ASGI application: static files, updates by WebSocket, pictures and recordings."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

from rsenf.dashboard.guard import Guard
from rsenf.dashboard.recordings import file_named, files_about, state_of
from rsenf.dashboard.session import Session
from rsenf.dashboard.site import Site
from rsenf.errors import UsageError

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
