"""Idle: from row blocks to the share of each frame in which nothing is read, by a named method."""

from __future__ import annotations

from collections.abc import Callable

from rsenf.errors import UsageError
from rsenf.flicker.shared import Follower
from rsenf.idle import coherent, line_ratio, vertical_phase
from rsenf.idle.seen import Finding, Seen
from rsenf.idle.settings import IdleSettings
from rsenf.idle.stage import IdleStage
from rsenf.stage import Stage

METHODS: dict[str, Callable[[Seen], Finding]] = {
    "coherent": coherent.conclude,
    "vertical_phase": vertical_phase.conclude,
    "line_ratio": line_ratio.continuous,
    "line_ratio_bins": line_ratio.binned,
}


def make_idle(settings: IdleSettings, follower: Follower | None = None) -> Stage:
    """Build the estimator that the settings name: row blocks in, idle estimates out.

    Parameters
    ----------
    settings : IdleSettings
    follower : Follower, optional
        One that is shared with another stage; of its own without.

    Raises
    ------
    UsageError
        When there is no method of that name.
    """
    if settings.method not in METHODS:
        raise UsageError(f"no idle method {settings.method!r}", f"one of {', '.join(METHODS)}")
    return IdleStage(settings, METHODS[settings.method], follower)


__all__ = ["METHODS", "IdleSettings", "make_idle"]
