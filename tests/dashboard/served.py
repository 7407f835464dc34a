"""A dashboard that is served, and cameras that it shows."""

from __future__ import annotations

import time

from messages_of import SITE, Camera, grid_hz

from rsenf.bus.inbox import Inbox
from rsenf.bus.keys import LOOKING, SIGNALS, health_key
from rsenf.dashboard.server import DashboardServer
from rsenf.dashboard.site import Site, Wiring
from tests.loopback import Loopback

FEEDS = ("door", "yard")


class Served:
    """A bus within this process, what is shown of it, and its server."""

    def __init__(self, wiring: Wiring) -> None:
        self.site = Site(wiring, time.time_ns)
        network = Loopback()
        self._bus, self._inbox = network.bus("sender"), Inbox()
        for key_expr in (f"rsenf/{SITE}/**", health_key(SITE, "*")):
            network.bus("dashboard").subscribe(self._inbox, key_expr, LOOKING)
        self._publishers = {}
        self.server = DashboardServer(self.site, "127.0.0.1", 0)

    @property
    def url(self) -> str:
        return self.server.url

    def put(self, *sent) -> None:
        """Send over the bus, and let the dashboard take it."""
        for key, message in sent:
            if key not in self._publishers:
                self._publishers[key] = self._bus.publisher(key, SIGNALS)
            self._publishers[key].send(message)
            received = self._inbox.receive(1.0)
            if received is not None:  # None: sent before
                self.site.update(received.key, received.message)


def camera_now(name: str, seconds: int = 30, **more) -> Camera:
    """A camera whose first seconds have just passed."""
    return Camera(name, grid_hz(600), time.time_ns() - seconds * 10**9, **more)
