"""The last columns of a growing image, with incremental updates for each viewer."""

from __future__ import annotations

import base64
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLANK = 0  # level of a column without measurement


class Columns:
    """Columns of bytes, the newest last.

    Parameters
    ----------
    keep : int
        Number of columns kept.

    Attributes
    ----------
    total : int
        Number of columns since the last reset.
    begun : int
        Number of resets, which happen when the image's height changes.
    """

    def __init__(self, keep: int) -> None:
        self.total = self.begun = 0
        self.height = 0
        self._kept: deque[bytes] = deque(maxlen=keep)

    def add(self, columns: NDArray[np.uint8]) -> None:
        """Add columns, an array of shape (columns, height)."""
        if columns.shape[1] != self.height:
            self.height, self.total = int(columns.shape[1]), 0
            self.begun += 1
            self._kept.clear()
        self._kept.extend(column.tobytes() for column in columns)
        self.total += len(columns)

    def add_blank(self, count: int) -> None:
        """Add columns without measurement."""
        if self.height and count > 0:
            count = min(count, self._kept.maxlen or count)
            self.add(np.full((count, self.height), BLANK, np.uint8))

    def since(self, seen: tuple[int, int]) -> dict[str, Any]:
        """Return the columns after those seen, for JSON; ``seen`` as in the property."""
        begun, total = seen
        fresh = self.total - total if begun == self.begun else self.total
        fresh = min(fresh, len(self._kept))
        # Index from the end: access to the middle of a deque is slow, and few columns are new.
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
        """Resets and columns up to now: the state of a viewer who has seen everything."""
        return self.begun, self.total
