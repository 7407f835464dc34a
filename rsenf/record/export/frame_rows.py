"""The columns of row blocks: one line a frame, one column for each row and strip.

Wide rather than long: a line is a frame with its exact time, so the columns of luma read as the
matrix that they are, and nothing is repeated hundreds of times.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from rsenf.errors import InputError
from rsenf.messages import RowBlock
from rsenf.record.export.columns import Columns

# Fields of a block that hold for each of its frames.
_OF_BLOCK = ("read_out_axis", "steady_ratio", "clipped_ratio", "usable", "reason")


class FrameRows(Columns):
    """Columns of the frames of row blocks; all of the shape of the first.

    Parameters
    ----------
    topic : str
        Topic that they come from.
    first : RowBlock
        The first block.
    """

    def __init__(self, topic: str, first: RowBlock) -> None:
        super().__init__(topic, RowBlock)
        self._shape = first.rows, first.strips
        self._levels = [
            f"luma_levels_row{row:04d}_strip{strip}"
            for row in range(first.rows)
            for strip in range(first.strips)
        ]
        own = [self.schema.field(name) for name in _OF_BLOCK]
        blocks = self.schema.get_field_index("arrival_time_ns") + 1
        self.schema = pa.schema(
            [
                *[self.schema.field(k) for k in range(blocks)],
                *own,
                pa.field("frame_number", pa.int64()),
                pa.field("frame_pts_ns", pa.int64()),
                *(pa.field(name, pa.float32()) for name in self._levels),
            ]
        )

    def lines(self, message: RowBlock, log_time_ns: int) -> list[dict[str, Any]]:
        """Return a line for each frame of a block.

        Raises
        ------
        InputError
            When the block has other rows or strips than the first.
        """
        if (message.rows, message.strips) != self._shape:
            raise InputError(
                f"the rows change from {self._shape[0]} × {self._shape[1]} strips to "
                f"{message.rows} × {message.strips} at frame {message.header.frame_first}",
                "export one stretch by itself, with --run and --epoch",
            )
        about = self.about(message.header, log_time_ns)
        about |= {name: getattr(message, name) for name in _OF_BLOCK}
        levels = np.reshape(message.level, (message.frames, -1)).tolist()
        times = zip(message.frame_number.tolist(), message.frame_pts_ns.tolist(), strict=True)
        return [
            about
            | {"frame_number": number, "frame_pts_ns": pts_ns}
            | dict(zip(self._levels, level, strict=True))
            for (number, pts_ns), level in zip(times, levels, strict=True)
        ]
