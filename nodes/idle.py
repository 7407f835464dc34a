"""Idle: row means in, estimates of the camera's idle period out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from rsenf.config.node_kind import Problem, unknown
from rsenf.idle.estimator_state import IdleSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import flicker_stages
from rsenf.stage import ALONE, StageContext, StageSpec

if TYPE_CHECKING:
    from rsenf.config.graph import Graph


class IdleNode(StageNode):
    """Estimates the idle period of the cameras."""

    kind: Literal["idle"]
    idle: IdleSettings = IdleSettings()

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the idle stage."""
        return flicker_stages(None, self.idle, context)

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield an unknown method."""
        from rsenf.idle import METHODS

        if self.idle.method not in METHODS:
            yield ("idle", "method"), unknown(METHODS, self.idle.method)
