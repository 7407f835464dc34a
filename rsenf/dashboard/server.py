"""Serves the page from a separate thread, to those who may see it.

Access is controlled by Host and Origin, against DNS rebinding and cross-site requests, and by a
password, where there is one.
"""

from __future__ import annotations

import base64
import hmac
import socket
import threading
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

from rsenf.config.check import is_own_host
from rsenf.dashboard.app import make_app, missing
from rsenf.dashboard.site import Site
from rsenf.errors import RsenfError, reason_of

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
    password : str
        Asked of every request by HTTP Basic authentication (RFC 7617), with any user name; empty:
        none is asked.
    """

    def __init__(self, app: App, host: str, password: str = "") -> None:
        self._app = app
        self._host = host
        self._password = password.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request or refuse it."""
        status, body = (0, b"") if scope["type"] == "lifespan" else self._refusal(scope)
        if not status:
            await self._app(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            headers = [(b"content-type", b"text/plain")]
            headers += [(b"www-authenticate", b'Basic realm="rsenf"')] if status == 401 else []
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": body})

    def _refusal(self, scope: Scope) -> tuple[int, bytes]:
        """Return the status that a request is refused with, and why; status 0 if it isn't."""
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        if not self._may(headers):
            return 403, REFUSED
        return (0, b"") if self._knows(headers) else (401, b"the password, please\n")

    def _knows(self, headers: dict[str, str]) -> bool:
        scheme, _, given = headers.get("authorization", "").partition(" ")
        try:
            said = base64.b64decode(given) if scheme.lower() == "basic" else b""
        except ValueError:
            said = b""
        is_right = hmac.compare_digest(said.partition(b":")[2], self._password)
        return is_right or not self._password

    def _may(self, headers: dict[str, str]) -> bool:
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


START_S, STOP_S = 10.0, 2.0


class DashboardServer:
    """An HTTP server for a ``with`` block.

    Parameters
    ----------
    site : Site
    host : str
        Address to listen at: ``127.0.0.1`` for this host only.
    port : int
        Port; 0 for any free one.
    password : str, optional
        Asked of every browser; empty for none.

    Attributes
    ----------
    url : str
        Address of the page.

    Raises
    ------
    UsageError
        When a required package isn't installed.
    RsenfError
        When the port can't be opened.
    """

    def __init__(self, site: Site, host: str, port: int, password: str = "") -> None:
        try:
            import uvicorn
            import websockets  # noqa: F401  # optional for uvicorn, but needed for the updates
        except ImportError as exc:
            raise missing(exc) from exc
        self._stop = threading.Event()
        app = Guard(make_app(site, self._stop), host, password)
        self._socket = _listening(host, port)
        named = f"[{host}]" if ":" in host else host
        self.url = f"http://{named}:{self._socket.getsockname()[1]}/"
        self._server = uvicorn.Server(
            uvicorn.Config(
                app,
                log_level="critical",
                lifespan="off",
                server_header=False,
                ws_max_size=65536,
                timeout_graceful_shutdown=1,
            )
        )
        self._thread = threading.Thread(target=self._serve, name="dashboard", daemon=True)

    def _serve(self) -> None:
        self._server.run(sockets=[self._socket])

    def __enter__(self) -> DashboardServer:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._socket.close()


def _listening(host: str, port: int) -> socket.socket:
    """Open the port here, so that a port in use is reported at once."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family)
    except OSError as exc:
        raise RsenfError(
            f"can't serve at {host}:{port}: {reason_of(exc)}",
            "choose another port, or an address of this host",
        ) from exc


def open_to_all(host: str) -> str:
    """Return a warning if the page can be reached from other hosts; otherwise an empty text."""
    import ipaddress

    try:
        alone = ipaddress.ip_address(host).is_loopback
    except ValueError:
        alone = host == "localhost"
    if alone:
        return ""
    return f"the dashboard at {host} has no password: whoever reaches it sees all feeds"
