"""Track: row means in, ENF estimates and, if requested, idle estimates out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from rsenf.config.node_kind import Problem, unknown
from rsenf.idle.estimator_state import IdleSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import flicker_stages
from rsenf.stage import ALONE, StageContext, StageSpec
from rsenf.track.method import TrackSettings

if TYPE_CHECKING:
    from rsenf.config.graph import Graph


class TrackNode(StageNode):
    """Estimates the ENF and, if requested, the idle period along with it."""

    kind: Literal["track"]
    track: TrackSettings = TrackSettings()
    idle: IdleSettings | None = Field(
        None,
        description="send idle estimates, too: cheaper than by a node of their own; {} for them",
    )

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the track stage, and the idle stage if requested."""
        return flicker_stages(self.track, self.idle, context)

    def rows_needed(self) -> Mapping[str, Any]:
        """Return settings of the rows stage that the method requires."""
        from rsenf.track import METHODS

        method = METHODS.get(self.track.method)
        return method.rows_needed if method else {}

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield unknown methods, and settings that the method ignores."""
        from rsenf.idle import METHODS as IDLE_METHODS
        from rsenf.track import METHODS

        if self.track.method not in METHODS:
            yield ("track", "method"), unknown(METHODS, self.track.method)
        else:
            for name in METHODS[self.track.method].ignored(self.track):
                yield ("track", name), f"{self.track.method} has no use for it: leave it out"
        if self.idle and self.idle.method not in IDLE_METHODS:
            yield ("idle", "method"), unknown(IDLE_METHODS, self.idle.method)
