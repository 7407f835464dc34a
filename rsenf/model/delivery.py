"""Which of the captured frames arrive, and what time their stamps show."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rsenf.model.parameters import parameter
from rsenf.model.seeds import generator

Int64Array = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Delivery:
    """Frames lost on their way, at random times."""

    drops_per_min: float = parameter(0.0, "frames lost per minute, on average", low=0, high=600)
    retimed: bool = parameter(
        False, "stamps run on as if nothing was lost, where they would leave a hole"
    )

    def dropped(self, frames: int, frame_rate: Fraction, seed: int) -> Int64Array:
        """Numbers of the captured frames that are lost, in order; never frame 0."""
        chance = min(self.drops_per_min / (60 * float(frame_rate)), 1.0)
        if not chance:
            return np.empty(0, np.int64)
        rng = generator(seed, "dropped frames")
        numbers, last = [], 0
        while (last := last + int(rng.geometric(chance))) < frames:
            numbers.append(last)
        return np.array(numbers, np.int64)

    def stamp(self, frame_number: Int64Array, dropped: Int64Array) -> Int64Array:
        """Presentation time of each delivered frame, in frame periods."""
        if not self.retimed:
            return frame_number
        return np.asarray(frame_number - np.searchsorted(dropped, frame_number), np.int64)

    def effects(self) -> list[dict[str, object]]:
        """Name what this delivery does."""
        if not self.drops_per_min:
            return []
        parameters = {"drops_per_min": self.drops_per_min, "retimed": self.retimed}
        return [{"name": "frame_drop", "parameters": parameters}]
