"""The shutter: order and speed of the read-out of a frame's lines."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from rsenf.model.parameters import parameter

NTSC_30 = Fraction(30000, 1001)


@dataclass(frozen=True, kw_only=True)
class Shutter:
    """A rolling or global shutter.

    Times are by the camera's own clock. A line is what is exposed together: a row, or a column if
    the read-out runs along the columns, as in a phone held upright.
    """

    frame_rate: Fraction = parameter(
        NTSC_30, "frames per second of the camera's clock", low=1, high=1000
    )
    rows: int = parameter(720, "rows of a frame", low=16, high=8192)
    columns: int = parameter(1280, "columns of a frame", low=16, high=8192)
    idle_ratio: float = parameter(
        0.38, "share of the frame period in which no line is read", low=0, high=0.99
    )
    read_out: str = parameter(
        "rows",
        "rows, top to bottom; columns, left to right; or global, all at once",
        choices=("rows", "columns", "global"),
    )

    @property
    def lines(self) -> int:
        """Lines of a frame, in the order of their read-out."""
        return self.columns if self.read_out == "columns" else self.rows

    @property
    def across_px(self) -> int:
        """Pixels in a line."""
        return self.rows if self.read_out == "columns" else self.columns

    @property
    def read_out_time_s(self) -> float:
        """Time from line 0 to one past the last: ``T_ro = (1 − ρ) / F_r``; 0 if global."""
        return 0.0 if self.read_out == "global" else (1 - self.idle_ratio) / float(self.frame_rate)
