"""Trackers and idle estimators of one process: they follow the flicker once, where that is so."""

from __future__ import annotations

from rsenf.flicker.acquire import MIN_SNR
from rsenf.flicker.follower import FlickerFollower
from rsenf.flicker.shared import Follower, shared
from rsenf.idle import IdleSettings, make_idle
from rsenf.stage import Stage
from rsenf.track import TrackSettings, make_tracker


class FollowingStages:
    """Makes both stages anew for each epoch. They must be given the same blocks.

    Parameters
    ----------
    track, idle : TrackSettings, IdleSettings, optional
        Of those stages that there are.
    """

    def __init__(self, track: TrackSettings | None, idle: IdleSettings | None) -> None:
        self._track, self._idle = track or TrackSettings(), idle or IdleSettings()
        self._share = track is not None and idle is not None and _alike(track, idle)
        self._left: Follower | None = None  # of an epoch of which the other stage isn't made yet

    def tracker(self) -> Stage:
        """Return a tracker."""
        return make_tracker(self._track, self._follower())

    def idle(self) -> Stage:
        """Return an idle estimator."""
        return make_idle(self._idle, self._follower())

    def _follower(self) -> Follower | None:
        """Return one of a pair, then the other; nothing where each stage follows by itself."""
        if not self._share:
            return None
        if self._left is None:
            one, self._left = shared(FlickerFollower(self._idle.nominal_hz))
            return one
        other, self._left = self._left, None
        return other


def _alike(track: TrackSettings, idle: IdleSettings) -> bool:
    """Whether both would follow the flicker in just the same way."""
    same = (track.method, track.nominal_hz) == ("projection", idle.nominal_hz)
    return same and track.min_snr == MIN_SNR
