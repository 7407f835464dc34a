"""Track: ENF estimates from row blocks, by a method chosen by name.

In: row blocks of one stream, and :class:`TrackSettings`. Out: ``EnfEstimate`` messages, as a rule
one a second. Read in this order::

    method                      settings; interface of a method; check of the frame rate
    projection                  the default method, by coherent tracking (``rsenf.flicker``)
    sliding, window             base class with sliding windows; one window's fit, and phase course
    stft, phase                 methods on one line of the rows
    alias                       methods of earlier publications, at ``f_0`` or its alias
    paper_templates, paper      the paper's, every line with every idle ratio
"""

from __future__ import annotations

from typing import Any

from rsenf.flicker.follower import Follower
from rsenf.registry import Registry
from rsenf.stage import Stage
from rsenf.track.method import EnfMethod, RateCheck, TrackSettings, check_method

METHODS: Registry[type[EnfMethod]] = Registry(
    "ENF method",
    "rsenf.methods",
    {
        "projection": "rsenf.track.projection:ProjectionTracker",
        "stft": "rsenf.track.stft:StftTracker",
        "frame_mean": "rsenf.track.alias:FrameMeanTracker",
        "row_concat": "rsenf.track.alias:RowConcatTracker",
        "superpixel": "rsenf.track.alias:SuperpixelTracker",
        "phase": "rsenf.track.phase:PhaseStepTracker",
        "paper": "rsenf.track.paper:PaperTracker",
    },
    check_method,
)


def make_tracker(settings: TrackSettings, follower: Follower | None = None) -> Stage:
    """Build the estimator that the settings name.

    Parameters
    ----------
    settings : TrackSettings
    follower : Follower, optional
        Flicker follower shared with another stage, if the method can use it; else it makes its own.

    Raises
    ------
    UsageError
        If there is no method of that name.
    """
    method = METHODS.find(settings.method)
    shared: dict[str, Any] = {"follower": follower} if follower and method.shares_follower else {}
    return RateCheck(method(settings, **shared))


__all__ = ["METHODS", "EnfMethod", "TrackSettings", "make_tracker"]
