"""A matcher: a track and a reference in, a finding out; one interface for all methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from rsenf.errors import UsageError
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate

NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a matcher concludes, with lags on the reference's axis; NaN for what it can't tell.

    The fields are those of :class:`rsenf.messages.MatchResult`. Besides, ``claim_fit`` is the
    chance of a residual as large as that at the claimed start, were it the true one, and
    ``coverage_ratio`` the share of the possible lags that could be compared.
    """

    decision: str
    reason: str
    lag_s: float = NAN
    lag_std_s: float = NAN
    correlation: float = NAN
    log10_lr: float = NAN
    log10_lr_absent: float = NAN
    clock_ppm: float = NAN
    clock_std_ppm: float = NAN
    residual_std_hz: float = NAN
    expected_std_hz: float = NAN
    seconds_used: float = 0.0
    search_size: int = 0
    coverage_ratio: float = 1.0
    claim_fit: float = NAN
    verbal: str = ""
    candidates: tuple[Candidate, ...] = ()


class Matcher(Protocol):
    """One method of comparing a track with a reference."""

    def __call__(
        self, track: Track, grid: Grid, settings: MatchSettings, claimed_lag_s: float = NAN
    ) -> Finding:
        """Compare; a claimed lag is looked at as well, where given."""
        ...


def check_lengths(clip_s: float, reference_s: float) -> None:
    """Refuse a reference that can't hold the clip.

    Raises
    ------
    UsageError
        When the clip is longer than the reference.
    """
    if clip_s > reference_s:
        raise UsageError(
            f"the clip lasts {clip_s:.1f} s, the reference only {reference_s:.1f} s",
            "give a reference that covers the time searched",
        )


def nothing_to_decide(track: Track, grid: Grid, settings: MatchSettings) -> str:
    """Say why these two can't be compared at all; empty when they can."""
    usable_s = track.usable * track.hop_s
    if not track.usable:
        return "no usable signal"
    if usable_s < settings.min_seconds:
        return f"only {usable_s:g} usable seconds of ENF; at least {settings.min_seconds:g} needed"
    if round(track.nominal_hz) != round(grid.nominal_hz):
        return (
            f"the light follows a {track.nominal_hz:.0f} Hz grid, "
            f"the reference is of a {grid.nominal_hz:.0f} Hz one"
        )
    return ""
