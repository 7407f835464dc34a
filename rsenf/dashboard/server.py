"""Serves the page from a separate thread."""

from __future__ import annotations

import socket
import threading
from types import TracebackType

from rsenf.dashboard.app import make_app, missing
from rsenf.dashboard.site import Site
from rsenf.errors import RsenfError

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
        app = make_app(site, host, self._stop, password)
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
            f"can't serve at {host}:{port}: {(exc.strerror or str(exc)).lower()}",
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
