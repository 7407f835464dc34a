"""Settings of the rows stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

from rsenf.errors import UsageError

AXES: tuple[Literal["rows", "columns"], ...] = ("rows", "columns")
AUTO: Literal["auto"] = "auto"
ReadOut = Literal["rows", "columns", "auto"]


@dataclass(frozen=True)
class RowsSettings:
    """Settings of the rows stage.

    Parameters
    ----------
    read_out_axis : {'rows', 'columns', 'auto'}
        'columns' for video that was rotated before it was coded; 'auto' detects the axis, and
        sends nothing until it has.
    block_frames : int
        Frames per block; blocks begin at multiples of it.
    strips : int
        Strips of the picture's width, each with its own row means: flicker has one phase along a
        row, patterns seldom do.
    tiles : int
        Tiles across a row on which the mask decides, a multiple of the strips.
    mask : bool
        Leave out pixels where something moves.
    tile_means : bool
        Publish tile means too.
    stabilise : bool
        Follow a picture that moves as a whole, as one from a hand does.
    """

    # For Pydantic: an unknown key in a configuration file is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    read_out_axis: ReadOut = "rows"
    block_frames: int = 8
    strips: int = 8
    tiles: int = 8
    mask: bool = True
    tile_means: bool = False
    stabilise: bool = True

    def __post_init__(self) -> None:
        if self.read_out_axis not in get_args(ReadOut):
            raise UsageError(f"read_out_axis {self.read_out_axis!r}: 'rows', 'columns' or 'auto'")
        for name in ("block_frames", "strips", "tiles"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} of {getattr(self, name)}: at least 1")
        if self.tiles % self.strips:
            raise UsageError(f"{self.tiles} tiles can't be shared out among {self.strips} strips")
