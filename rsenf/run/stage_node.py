"""Base class of node kinds that run stages between topics of each camera, as most kinds do.

::

    class SmoothNode(StageNode):
        '''Smooths the ENF.'''

        kind: Literal["smooth"]
        window_s: float = 5.0

        def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
            return [StageSpec(("track",), ("track",), lambda: Smooth(self.window_s))]
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from rsenf.config.node_kind import Camera, NodeKind

if TYPE_CHECKING:
    from rsenf.run.node import NodeProcess


class StageNode(NodeKind):
    """Runs its stages for each camera, until the last stream that they read has ended."""

    cameras: tuple[Camera, ...] = Field(min_length=1)

    def body(self, node: NodeProcess) -> None:
        """Feed the stages of every camera."""
        from rsenf.run.pump import NodeContext, lane_of, pump

        lanes = [lane_of(node, c, self.stages(NodeContext(node, c))) for c in self.cameras]
        node.ready()
        pump(node, lanes)
