"""What every node of a graph file may say of its own supervision."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Strict(BaseModel):
    """Unknown keys are errors; what was read doesn't change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Restart(Strict):
    """When a node that dies, or hangs, is started again."""

    limit: int = Field(5, ge=0, description="times within within_s; after that it stays dead")
    within_s: float = Field(300.0, gt=0)
    backoff_s: float = Field(0.5, gt=0, description="pause before the first; doubles each time")
    backoff_max_s: float = Field(30.0, gt=0, description="longest pause")
    silent_s: float = Field(
        20.0, ge=3, description="without a word of its health it counts as hung, and is killed"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Restart:
        if self.backoff_max_s < self.backoff_s:
            raise ValueError(f"backoff_max_s {self.backoff_max_s:g} is below backoff_s")
        return self


class Supervised(Strict):
    """A node."""

    restart: Restart | None = Field(
        None, description="when it is started again; the graph's own rule unless given"
    )
