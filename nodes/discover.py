"""Discover: row means in, verdicts on effects that a model lacks and on changes out."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rsenf.discrepancy.settings import WatchSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import discover_stage
from rsenf.stage import ALONE, StageContext, StageSpec


class DiscoverNode(StageNode):
    """Finds effects that a model of the cameras lacks, and changes over time."""

    kind: Literal["discover"]
    model: str | None = Field(None, description="model file to begin with; a plain lamp without")
    discover: WatchSettings = WatchSettings()

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the discover stage."""
        return [discover_stage(self.discover, self.model, context)]
