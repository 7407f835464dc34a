"""Foxglove: shows the bus live to Foxglove clients, which connect by WebSocket."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from rsenf.config.node_kind import NodeKind, Problem, bad_key_expressions

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.run.node import NodeProcess


class FoxgloveNode(NodeKind):
    """Shows topics live in Foxglove, which connects by WebSocket."""

    kind: Literal["foxglove"]
    host: str = Field("127.0.0.1", description="address to listen at; this host alone unless given")
    port: int = Field(8765, ge=0, le=65535, description="0: any that is free")
    topics: tuple[str, ...] = Field(("**",), description="key expressions below the site")

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield invalid key expressions."""
        return bad_key_expressions(("topics", key_expr) for key_expr in self.topics)

    def body(self, node: NodeProcess) -> None:
        """Serve until every stream of the graph has ended, or until told to stop."""
        from rsenf.run.foxglove_bridge import FoxgloveBridge
        from rsenf.run.recording import look_until_ended

        site = node.graph.site
        with FoxgloveBridge(self.host, self.port, f"rsenf {site}", time.time_ns) as bridge:
            look_until_ended(
                node,
                self.topics,
                lambda received: bridge.send(received.key, received.message, received.payload),
                f"ws://{self.host}:{bridge.port}",
            )
