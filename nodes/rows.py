"""Rows: frames in, row means of the steady pixels out."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from rsenf.rows.settings import RowsSettings
from rsenf.run.stage_node import StageNode
from rsenf.run.stages import rows_stage
from rsenf.stage import ALONE, StageContext, StageSpec

if TYPE_CHECKING:
    from rsenf.run.node import NodeProcess


class RowsNode(StageNode):
    """Takes row means of the steady pixels."""

    kind: Literal["rows"]
    rows: RowsSettings = RowsSettings()

    def stages(self, context: StageContext = ALONE) -> list[StageSpec]:
        """Return the rows stage."""
        return [rows_stage(self.rows)]

    def body(self, node: NodeProcess) -> None:
        """Sample every camera's frames until all streams have ended."""
        from rsenf.bus.frames import FrameReceiver
        from rsenf.config.graph import runs_ahead
        from rsenf.run.pump import lane_of, pump

        ahead = {camera: runs_ahead(node.graph, camera) for camera in self.cameras}
        lanes = [
            lane_of(node, camera, self.stages(), FrameReceiver(), ahead=ahead[camera])
            for camera in self.cameras
        ]
        node.ready()
        pump(node, lanes)
