"""Settings of the discrepancy watch on a stream, and lengths and sizes that the workflow needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rsenf.errors import UsageError

# Blocks are long enough for the grid to move within one, and short enough for twenty in a minute.
BLOCK_S = 3.0
FEWEST_BLOCKS = 8  # a shorter recording has shorter blocks
SHORTEST_S = 7.0
SHORTEST_WINDOW_S = FEWEST_BLOCKS * BLOCK_S + 1.0  # its last frame begins before its end
FEWEST_LINES = 16


@dataclass(frozen=True)
class WatchSettings:
    """Settings of the watch.

    Parameters
    ----------
    nominal_hz : float, optional
        50 or 60; by default found from the data.
    window_s : float
        Length of the window, the newest part of the stream.
    every_s : float
        Stream time between verdicts; the first comes when a window is full.
    lines : int
        Largest number of lines that the rows of a frame are averaged to; the cost of a verdict is
        proportional to it. An averaged row acts as one of longer exposure; differences between its
        rows, as of interlaced fields, are lost.
    """

    # For the validation of configuration files: a misspelt key is an error.
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
