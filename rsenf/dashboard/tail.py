"""The last columns of a picture that grows: whoever has seen some is told the rest."""

from __future__ import annotations

import base64
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLANK = 0  # a level that no measurement has: there was none


class Columns:
    """Columns of bytes, the newest last.

    Parameters
    ----------
    keep : int
        How many.

    Attributes
    ----------
    total : int
        How many there have been.
    begun : int
        Counts how often all of them were thrown away, since the picture's height changed.
    """

    def __init__(self, keep: int) -> None:
        self.total = self.begun = 0
        self.height = 0
        self._kept: deque[bytes] = deque(maxlen=keep)

    def add(self, columns: NDArray[np.uint8]) -> None:
        """Add columns, one a row of the array."""
        if columns.shape[1] != self.height:
            self.height, self.total = int(columns.shape[1]), 0
            self.begun += 1
            self._kept.clear()
        self._kept.extend(column.tobytes() for column in columns)
        self.total += len(columns)

    def add_blank(self, count: int) -> None:
        """Add columns of which nothing is known."""
        if self.height and count > 0:
            count = min(count, self._kept.maxlen or count)
            self.add(np.full((count, self.height), BLANK, np.uint8))

    def since(self, seen: tuple[int, int]) -> dict[str, Any]:
        """What to tell whoever has seen so many columns of that beginning, for JSON."""
        begun, total = seen
        fresh = self.total - total if begun == self.begun else self.total
        fresh = min(fresh, len(self._kept))
        # A deque is slow in its middle: what is new is mostly little, and at its end.
        newest = [self._kept[-1 - back] for back in range(fresh)][::-1]
        return {
            "reset": begun != self.begun,
            "height": self.height,
            "columns": fresh,
            "keep": self._kept.maxlen,
            "data": base64.b64encode(b"".join(newest)).decode(),
        }

    @property
    def seen(self) -> tuple[int, int]:
        """What somebody has seen who has seen all."""
        return self.begun, self.total
