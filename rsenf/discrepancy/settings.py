"""What the watch over a stream may be told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rsenf.errors import UsageError

# Long enough for the grid to move within one, short enough for twenty of them in a minute.
BLOCK_S = 3.0
FEWEST_BLOCKS = 8  # of a shorter recording the blocks are shorter
SHORTEST_S = 7.0
SHORTEST_WINDOW_S = FEWEST_BLOCKS * BLOCK_S + 1.0  # its last frame begins before its end
FEWEST_LINES = 16


@dataclass(frozen=True)
class WatchSettings:
    """Settings of the watch.

    Parameters
    ----------
    nominal_hz : float, optional
        50 or 60; found from the data when not given.
    window_s : float
        Of the newest rows, how much is looked at.
    every_s : float
        Stream time between verdicts; the first comes when a window is full.
    lines : int
        To which the rows of a frame are averaged down, if there are more: what a verdict costs is
        proportional to it. Neighbours that are averaged are as one with a longer exposure; what
        differs between them, as the two fields of an interlaced picture do, is lost.
    """

    # Read by whoever validates a configuration file: a misspelt key is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    nominal_hz: float | None = None
    window_s: float = 60.0
    every_s: float = 30.0
    lines: int = 240

    def __post_init__(self) -> None:
        if self.nominal_hz not in (None, 50.0, 60.0):
            raise UsageError(f"nominal frequency {self.nominal_hz} Hz: 50 or 60")
        if not self.window_s >= SHORTEST_WINDOW_S:
            raise UsageError(f"a window of {self.window_s} s: {SHORTEST_WINDOW_S:g} is the least")
        if not self.every_s >= BLOCK_S:
            raise UsageError(f"a verdict every {self.every_s} s: {BLOCK_S:g} is the least")
        if self.lines < FEWEST_LINES:
            raise UsageError(f"{self.lines} lines a frame: {FEWEST_LINES} are the least")
