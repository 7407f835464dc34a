"""Track: from row blocks to ENF estimates, by a method chosen by name."""

from __future__ import annotations

from collections.abc import Callable

from rsenf.errors import UsageError
from rsenf.flicker.shared import Follower
from rsenf.stage import Stage
from rsenf.track.frame_mean import FrameMeanTracker
from rsenf.track.paper import PaperTracker
from rsenf.track.phase import PhaseTracker
from rsenf.track.projection import ProjectionTracker
from rsenf.track.row_concat import RowConcatTracker
from rsenf.track.settings import TrackSettings
from rsenf.track.stft import StftTracker
from rsenf.track.superpixel import SuperpixelTracker

METHODS: dict[str, Callable[[TrackSettings], Stage]] = {
    "projection": ProjectionTracker,
    "stft": StftTracker,
    "frame_mean": FrameMeanTracker,
    "row_concat": RowConcatTracker,
    "superpixel": SuperpixelTracker,
    "phase": PhaseTracker,
    "paper": PaperTracker,
}


def make_tracker(settings: TrackSettings, follower: Follower | None = None) -> Stage:
    """Build the estimator that the settings name.

    Parameters
    ----------
    settings : TrackSettings
    follower : Follower, optional
        One that ``projection`` shares with another stage; of its own without.

    Raises
    ------
    UsageError
        When there is no method of that name.
    """
    if settings.method not in METHODS:
        raise UsageError(f"no ENF method {settings.method!r}", f"one of {', '.join(METHODS)}")
    if follower is not None and settings.method == "projection":
        return ProjectionTracker(settings, follower)
    return METHODS[settings.method](settings)


__all__ = ["METHODS", "TrackSettings", "make_tracker"]
