"""Match: ENF estimates and a grid's reference in, times of recording out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from rsenf.config.node_kind import Name, Problem, unknown
from rsenf.match.settings import MatchSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import match_stage
from rsenf.stage import ALONE, StageContext, StageSpec

if TYPE_CHECKING:
    from rsenf.config.graph import Graph
    from rsenf.match import Match


class MatchNode(StageNode):
    """Compares ENF with a reference."""

    kind: Literal["match"]
    grid: Name
    method: str = "phase"
    interim_every_s: float = Field(
        0.0, ge=0, description="0: a result at the end only; of long clips, after a quarter more"
    )
    keep_hours: float = Field(
        24.0, ge=0, description="of estimates, and of a growing reference, to go by; 0: all"
    )
    match: MatchSettings = MatchSettings()

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the match stage."""

        def make() -> Match:
            from rsenf.match import Match

            return Match(
                method=self.method,
                grid=self.grid,
                interim_every_s=self.interim_every_s,
                settings=self.match,
                keep_hours=self.keep_hours,
                # A restartable node, or one of several cameras, goes on after an unusable series.
                on_refused=context.refused if context.stays or len(self.cameras) > 1 else None,
            )

        return [match_stage(make)]

    def problems(self, graph: Graph) -> Iterator[Problem]:
        """Yield an unknown method, one that needs another ENF method, and a self-reference."""
        from rsenf.match import METHODS, tracker_for

        if self.method not in METHODS:
            yield ("method",), unknown(METHODS, self.method)
        yield from graph.mirrors(self)
        needed = tracker_for(self.method)
        for camera in self.cameras if needed else ():
            sender = graph.sender("track", camera)
            track = getattr(sender, "track", None)
            if track is not None and track.method != needed:
                text = f"{self.method} needs the ENF method {needed!r}, not {track.method!r}"
                yield ("method",), text
