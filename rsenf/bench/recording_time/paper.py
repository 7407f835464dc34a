"""What the paper published of its four metrics, in per cent, and the marks to reach."""

from __future__ import annotations

from dataclasses import dataclass

from rsenf.bench.plan import LOSSLESS
from rsenf.bench.recording_time.plan import MOVING, STILL


@dataclass(frozen=True)
class Published:
    """One of the paper's tables.

    Parameters
    ----------
    kind : str
    videos : int
    coded : bool
        Whether the videos had been compressed.
    true, false : tuple of float
        Decisions by Metrics 1 to 4, per cent; the rest is none.
    """

    kind: str
    videos: int
    coded: bool
    true: tuple[float, ...]
    false: tuple[float, ...]


PUBLISHED = (
    Published(STILL, 12, False, (100.0,) * 4, (0.0,) * 4),
    Published(STILL, 48, True, (45.83, 56.25, 68.75, 70.83), (0.0, 4.17, 4.17, 2.08)),
    Published(MOVING, 24, True, (62.5, 75.0, 79.16, 83.33), (8.33, 8.33, 12.5, 8.33)),
)


@dataclass(frozen=True)
class Mark:
    """A share of true decisions to reach, of all kinds of films together."""

    coding: str
    length_s: float
    true_percent: float


DEFAULT = "phase"
MARKS = (Mark(LOSSLESS, 60.0, 95.0), Mark("50k", 120.0, 90.0))
# False decisions to stay below where the true time is absent, of clips at least so long.
FALSE_PERCENT, FALSE_FROM_S = 1.0, 120.0
