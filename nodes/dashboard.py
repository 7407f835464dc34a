"""Dashboard: all feeds on a web page, live."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from rsenf.config.node_kind import NodeKind, Problem, bad_key_expressions
from rsenf.errors import UsageError

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.run.node import NodeProcess


class DashboardNode(NodeKind):
    """Shows all feeds on a web page."""

    kind: Literal["dashboard"]
    host: str = Field("127.0.0.1", description="address to listen at; this host alone unless given")
    port: int = Field(8780, ge=0, le=65535, description="0: any that is free")
    topics: tuple[str, ...] = Field(
        ("*/rows", "*/track", "*/idle", "*/match", "*/live", "*/alarm", "*/video", "reference/*"),
        description="key expressions below the site",
    )
    archive: str | None = Field(
        None, description="folder of alarms' recordings; the record node's unless given"
    )

    password_env: str | None = Field(None, description="variable with the page's password")

    shows_all = True

    def check_ready(self, name: str, site: str) -> None:
        """Raise UsageError when the variable with the password isn't set."""
        if self.password_env and not os.environ.get(self.password_env):
            raise UsageError(f"{name}: password_env {self.password_env} is not set", "export it")

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield invalid key expressions."""
        return bad_key_expressions(("topics", key_expr) for key_expr in self.topics)

    def body(self, node: NodeProcess) -> None:
        """Serve until every stream of the graph has ended, or until told to stop."""
        from rsenf.dashboard.server import DashboardServer, open_to_all
        from rsenf.dashboard.site import Site, key_expressions, wiring_of
        from rsenf.run.recording import look_until_ended

        password = os.environ.get(self.password_env, "") if self.password_env else ""
        wiring = wiring_of(node.graph, self.archive)
        with (
            Site(wiring, time.time_ns) as shown,
            DashboardServer(shown, self.host, self.port, password) as server,
        ):
            look_until_ended(
                node,
                self.topics,
                lambda received: shown.update(received.key, received.message),
                "; ".join(filter(None, [server.url, "" if password else open_to_all(self.host)])),
                key_expressions(wiring),
            )
