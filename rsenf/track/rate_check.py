"""Withholds frequencies if the frame rate is only assumed, and suggests others if none is found."""

from __future__ import annotations

import dataclasses
from typing import Any

from rsenf.flicker.frame_rate import DOUBTFUL, GIVE_RATE, UNTIMED, FrameRateFinder, PerFrame
from rsenf.messages import EnfEstimate, RateBasis, RowBlock
from rsenf.track.method import EnfMethod


class RateCheck:
    """Wraps a tracker, and checks whether the frame rate of its estimates is known.

    Implements ``rsenf.stage.Stage``.

    Parameters
    ----------
    method : EnfMethod
    """

    def __init__(self, method: EnfMethod) -> None:
        self._method = method
        self._finder: FrameRateFinder | None = FrameRateFinder(method.settings.nominal_hz)

    def update(self, message: RowBlock) -> list[Any]:
        """Take a block of rows; return the estimates that it completes."""
        if self._finder is not None:
            self._finder.add(message)
        return self._checked(self._method.update(message))

    def flush(self) -> list[Any]:
        """Return the estimates that the end of the stream completes."""
        return self._checked(self._method.flush())

    def _checked(self, estimates: list[Any]) -> list[Any]:
        if self._finder is None or not estimates:
            return estimates
        if estimates[0].header.rate_basis == RateBasis.ASSUMED:
            return [_untimed(estimate, self._finder.found()) for estimate in estimates]
        if any(estimate.usable for estimate in estimates):
            self._finder = None  # the rate is right, or near it
            return estimates
        return [self._doubted(estimate, self._finder) for estimate in estimates]

    @staticmethod
    def _doubted(estimate: EnfEstimate, finder: FrameRateFinder) -> EnfEstimate:
        """Add the frame rates at which there would be light, if there is none at this one."""
        found = finder.found() if estimate.reason in DOUBTFUL else None
        rates = found.hypotheses if found else ()
        return dataclasses.replace(estimate, rate_hypotheses=rates)


def _untimed(estimate: EnfEstimate, found: PerFrame | None) -> EnfEstimate:
    """Return an estimate without what depends on a known frame rate."""
    reason = estimate.reason
    if found or estimate.usable:
        reason = f"{UNTIMED}: {found.words if found else GIVE_RATE}"
    return EnfEstimate(
        header=estimate.header,
        method=estimate.method,
        rank=estimate.rank,
        harmonic=estimate.harmonic,
        origin_pts_ns=estimate.origin_pts_ns,
        start_pts_ns=estimate.start_pts_ns,
        end_pts_ns=estimate.end_pts_ns,
        frame_rate_hz=estimate.frame_rate_hz,
        snr_db=estimate.snr_db,
        reason=reason,
        rate_hypotheses=found.hypotheses if found else (),
    )
