"""What the judge of liveness may be told, with the reason for each default."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from typing import ClassVar

from rsenf.errors import UsageError

VERSION = 1
FILE = "limits.json"


@dataclass(frozen=True)
class Limits:
    """How much evidence a verdict takes, in nats; a running sum is kept between the two ends.

    Fitted by ``rsenf bench live``; ``limits.json`` says on what.

    Parameters
    ----------
    live : float
        At which sum a feed is called live.
    stale : float
        At which sum, below 0, it is called stale.
    most : float
        Where the sum stops. From there down to ``stale`` is what it takes to give up a feed that
        has been live for long, and what false alarms are rare by.
    least : float
        Where the sum stops below.
    """

    live: float
    stale: float
    most: float
    least: float

    def __post_init__(self) -> None:
        if not self.least <= self.stale < 0 < self.live <= self.most:
            raise UsageError("limits of the evidence: least ≤ stale < 0 < live ≤ most")


@lru_cache(maxsize=1)
def fitted_limits() -> Limits:
    """Return the limits that come with the program."""
    read = json.loads((files("rsenf.live") / FILE).read_text(encoding="utf-8"))
    if read["version"] != VERSION:
        raise UsageError(f"{FILE} is version {read['version']}, not {VERSION}")
    return Limits(**read["nats"])


@dataclass(frozen=True, kw_only=True)
class LiveSettings:
    """Settings of the judge of liveness.

    Parameters
    ----------
    earliest_s : float
        How old, at least, the picture of an honest feed is when it arrives, by the reference's
        clock; below 0 where a reference may be late itself.
    latest_s : float
        How old it is at most: what an encoder and a network may take. An older picture is stale.
    clock_scale_ppm : float
        Standard deviation of cameras' clock errors, before one is known.
    limits : Limits
        How much evidence a verdict takes.
    lost_s : float
        Without pictures for so long, a feed counts as lost.
    frozen_s : float
        With the same picture for so long, as frozen.
    loop_s : float
        So long a stretch of pictures, alike to the last bit to one before, is a loop.
    keep_hours : float
        Of the reference, and of the feed itself, to look up when a stale picture was taken.
    search_every_s : float
        Between two such searches.
    report_every_s : float
        Between two messages when nothing changes.
    """

    # Read by whoever validates a configuration file: a misspelt key is an error.
    __pydantic_config__: ClassVar = {"extra": "forbid"}

    earliest_s: float = -2.0
    latest_s: float = 6.0
    clock_scale_ppm: float = 50.0
    limits: Limits = field(default_factory=fitted_limits)
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
            if not getattr(self, name) > 0:
                raise UsageError(f"{name} of {getattr(self, name):g}: above 0")
