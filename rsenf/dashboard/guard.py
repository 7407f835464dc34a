"""Access control by Host and Origin: protects against DNS rebinding and cross-site WebSockets."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

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
