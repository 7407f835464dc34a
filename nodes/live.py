"""Live: rows, estimates and a grid's reference in; verdicts on liveness and alarms out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import datetime
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from rsenf.config.node_kind import Name, Problem
from rsenf.live.settings import LiveSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import live_stage
from rsenf.stage import ALONE, StageContext, StageSpec
from rsenf.timebase import since_1970_ns

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.live import Live
    from rsenf.run.node import NodeProcess


class LiveNode(StageNode):
    """Judges whether feeds are live: whether their flicker follows the grid now."""

    kind: Literal["live"]
    grid: Name
    start: datetime | None = Field(
        None, description="when a file's or a simulation's first picture was taken, UTC"
    )
    live: LiveSettings = LiveSettings()

    @property
    def start_utc_ns(self) -> int:
        """``start`` in ns since 1970; 0 to use arrival times."""
        return since_1970_ns(self.start) if self.start else 0

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the liveness stage. With ``start`` (a file) silence isn't reported."""

        def make() -> Live:
            from rsenf.live import Live

            return Live(self.live, start_utc_ns=self.start_utc_ns, on_late=context.late)

        return [live_stage(make, math.inf if self.start else self.live.lost_s)]

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield a camera whose reference is measured by itself."""
        return graph.mirrors(self)

    def body(self, node: NodeProcess) -> None:
        """Judge every camera until all streams have ended."""
        # Imported before the first verdict needs it, so that no input waits for the import.
        import scipy.linalg  # noqa: F401

        super().body(node)
