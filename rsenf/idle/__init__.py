"""Idle: estimates the share of each frame period in which no row is read, by a named method.

In: row blocks of one stream, and :class:`IdleSettings`. Out: ``IdleEstimate`` messages: idle ratio
and read-out time with their errors, or the reason why there are none. Read in this order::

    stage                             collects a stream, and calls the method
    pairing, moments                  rows with phases; sums over frames
    estimator_state                   settings; what a method is given, and what it concludes
    coherent                          the default method: maximum likelihood; and its bound
    ramp                              profile likelihood of the phase ramp, and its error
    row_methods                       earlier ones, from rows' own tones: line ratio, vertical phase
    refusals                          when nothing is reported
    compare                           two recordings compared; known cameras
"""

from __future__ import annotations

from collections.abc import Callable

from rsenf.flicker.follower import Follower
from rsenf.idle.estimator_state import EstimatorState, Finding, IdleSettings
from rsenf.idle.stage import IdleStage
from rsenf.registry import Registry
from rsenf.stage import Stage

METHODS: Registry[Callable[[EstimatorState], Finding]] = Registry(
    "idle method",
    "rsenf.idle_methods",
    {
        "coherent": "rsenf.idle.coherent:conclude",
        "vertical_phase": "rsenf.idle.row_methods:vertical_phase",
        "line_ratio": "rsenf.idle.row_methods:continuous",
        "line_ratio_bins": "rsenf.idle.row_methods:binned",
    },
)


def make_idle(settings: IdleSettings, follower: Follower | None = None) -> Stage:
    """Build the estimator that the settings name: row blocks in, idle estimates out.

    Parameters
    ----------
    settings : IdleSettings
    follower : Follower, optional
        Flicker follower shared with another stage; by default its own.

    Raises
    ------
    UsageError
        If there is no method of that name.
    """
    return IdleStage(settings, METHODS.find(settings.method), follower)


__all__ = ["METHODS", "Finding", "IdleSettings", "EstimatorState", "make_idle"]
