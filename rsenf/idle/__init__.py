"""Idle: estimates the share of each frame period in which no row is read, by a named method.

In: row blocks of one stream, and :class:`IdleSettings`. Out: ``IdleEstimate`` messages: idle ratio
and read-out time with their errors, or the reason why there are none. Read in this order::

    settings, stage                   settings; collects a stream, and calls the method
    pairing, moments, still_rows      rows with phases; sums over frames; rows for an alias at 0 Hz
    estimator_state                   what a method is given, and what it concludes
    coherent                          the default method: maximum likelihood
    ramp, jackknife, bound            profile likelihood of the phase ramp; its error; the bound
    row_tones                         each row's amplitude, for the earlier methods:
    line_ratio, vertical_phase        the paper's; from neighbouring rows' phases
    limits, sawtooth                  when nothing is reported
    compare, cameras                  two recordings compared; known cameras
"""

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
        Flicker follower shared with another stage; by default its own.

    Raises
    ------
    UsageError
        If there is no method of that name.
    """
    return IdleStage(settings, METHODS.find(settings.method), follower)


__all__ = ["METHODS", "Finding", "IdleSettings", "EstimatorState", "make_idle"]
