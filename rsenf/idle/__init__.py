"""Idle: from row blocks to the share of each frame in which nothing is read, by a named method."""

from __future__ import annotations

from collections.abc import Callable

from rsenf.flicker.shared import Follower
from rsenf.idle.estimator_state import EstimatorState, Finding
from rsenf.idle.settings import IdleSettings
from rsenf.idle.stage import IdleStage
from rsenf.registry import Registry
from rsenf.stage import Stage

METHODS: Registry[Callable[[EstimatorState], Finding]] = Registry(
    "idle method",
    "rsenf.idle_methods",
    {
        "coherent": "rsenf.idle.coherent:conclude",
        "vertical_phase": "rsenf.idle.vertical_phase:conclude",
        "line_ratio": "rsenf.idle.line_ratio:continuous",
        "line_ratio_bins": "rsenf.idle.line_ratio:binned",
    },
)


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
    return IdleStage(settings, METHODS.find(settings.method), follower)


__all__ = ["METHODS", "Finding", "IdleSettings", "EstimatorState", "make_idle"]
