"""Discover: row means in, verdicts on what a model lacks and on what changes out."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from rsenf.discrepancy.settings import WatchSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import discover_stage
from rsenf.stage import ALONE, StageContext, StageSpec


class DiscoverNode(StageNode):
    """Watches for what a model of the cameras lacks, and names what changes."""

    kind: Literal["discover"]
    model: str | None = Field(None, description="model file to begin with; a plain lamp without")
    discover: WatchSettings = WatchSettings()

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Watch."""
        return [discover_stage(self.discover, self.model, context)]
