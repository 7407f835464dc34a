"""Settings of liveness detection, and the fitted limits of its test."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from typing import ClassVar

from rsenf.errors import UsageError

VERSION = 1
FILE = "limits.json"


@dataclass(frozen=True)
class Limits:
    """Limits of the CUSUM, in nats. ``limits.json`` says how those that are shipped were chosen.

    Parameters
    ----------
    live : float
        Sum at which a feed is called live.
    stale : float
        Sum, below 0, at which it is called stale.
    most : float
        Upper limit of the sum. The distance from here to ``stale`` is the evidence needed to call a
        feed stale that has been live for long, which keeps false alarms rare.
    least : float
        Lower limit of the sum.
    """

    live: float
    stale: float
    most: float
    least: float

    def __post_init__(self) -> None:
        if not self.least <= self.stale < 0 < self.live <= self.most:
            raise UsageError("limits of the evidence: least ≤ stale < 0 < live ≤ most")


@lru_cache(maxsize=1)
def shipped_limits() -> Limits:
    """Return the limits that are shipped with rsenf.

    Raises
    ------
    UsageError
        When their file is of another version.
    """
    read = json.loads((files("rsenf.live") / FILE).read_text(encoding="utf-8"))
    if read["version"] != VERSION:
        raise UsageError(f"{FILE} is version {read['version']}, not {VERSION}")
    return Limits(**read["nats"])


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """Settings of liveness detection.

    Parameters
    ----------
    earliest_s : float
        Smallest age of a live feed's picture on arrival, by the reference's clock; negative if the
        reference itself may be late.
    latest_s : float
        Largest age of a live feed's picture, caused by encoder and network. An older picture is
        stale.
    clock_scale_ppm : float
        Prior standard deviation of cameras' clock errors.
    limits : Limits
        Evidence needed for a verdict.
    lost_s : float
        Time without pictures after which a feed counts as lost.
    frozen_s : float
        Time with the same picture after which a feed counts as frozen.
    loop_s : float
        Length of a sequence of pictures that counts as a loop if it repeats an earlier one exactly.
    keep_hours : float
        Time for which the reference and the feed's own ENF are kept, to find when a stale picture
        was taken.
    search_every_s : float
        Time between two such searches.
    report_every_s : float
        Time between two messages when nothing changes.
    """

    # For validation by pydantic: unknown keys are errors.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    earliest_s: float = -2.0
    latest_s: float = 6.0
    clock_scale_ppm: float = 50.0
    limits: Limits = field(default_factory=shipped_limits)
    lost_s: float = 5.0
    frozen_s: float = 5.0
    loop_s: float = 1.0
    keep_hours: float = 24.0
    search_every_s: float = 60.0
    report_every_s: float = 1.0

    def __post_init__(self) -> None:
        if not self.earliest_s < self.latest_s <= self.earliest_s + 60:
            raise UsageError(
                f"pictures {self.earliest_s:g} to {self.latest_s:g} s old: at most a minute apart"
            )
        for name in ("clock_scale_ppm", "lost_s", "frozen_s", "loop_s", "keep_hours"):
            if not 0 < getattr(self, name) < math.inf:
                raise UsageError(f"{name} of {getattr(self, name):g}: above 0")
