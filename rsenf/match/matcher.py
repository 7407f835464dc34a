"""A matcher: a track and a reference in, a finding out; one interface for all methods."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from rsenf.errors import UsageError
from rsenf.match.evidence import verbal
from rsenf.match.paper_tracks import Hypotheses
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate, Edit, Segment
from rsenf.timebase import nanoseconds, seconds, utc_text

NEAR_HZ = 0.5  # frequencies nearer than this have the same nominal one

# Grids stay nearer to their nominal frequency, but for a few minutes in many years: then the
# reference shows it.
FARTHEST_HZ, BESIDE_HZ = 0.1, 0.02
PIECE = 1 << 20  # samples of a reference looked at together
NAN = float("nan")
ENOUGH_COVERAGE = 0.5  # of the possible lags, before "not in this reference" is said


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What a matcher concludes, with lags on the reference's axis; NaN for what it can't tell.

    The fields are those of :class:`rsenf.messages.MatchResult`. Besides, ``grid`` is the reference
    that the lag is in; ``claim_fit`` is the chance of a residual as large as that at the claimed
    start, were it the true one; ``coverage_ratio`` is the share of the possible lags that could be
    compared.
    """

    decision: str
    reason: str
    grid: Grid | None = None
    lag_s: float = NAN
    lag_std_s: float = NAN
    correlation: float = NAN
    log10_lr: float = NAN
    log10_lr_absent: float = NAN
    clock_ppm: float = NAN
    clock_std_ppm: float = NAN
    residual_std_hz: float = NAN
    expected_std_hz: float = NAN
    idle_ratio: float = NAN
    seconds_used: float = 0.0
    search_size: int = 0
    coverage_ratio: float = 1.0
    claim_fit: float = NAN
    claim_log10_lr: float = NAN
    claim_log10_lr_other: float = NAN
    verbal: str = ""
    candidates: tuple[Candidate, ...] = ()
    warnings: tuple[str, ...] = ()
    segments: tuple[Segment, ...] = ()
    edits: tuple[Edit, ...] = ()


class Matcher(Protocol):
    """One method of comparing a track with references."""

    def __call__(
        self,
        track: Track,
        grids: Sequence[Grid],
        settings: MatchSettings,
        claimed_utc_ns: int = 0,
    ) -> Finding:
        """Compare; a claimed start, UTC since 1970, is looked at as well, where given."""
        ...


class HypothesisMatcher(ABC):
    """One method of comparing all hypotheses of an ENF method, and not one track.

    Attributes
    ----------
    enf_method : str
        Name of the ENF method whose hypotheses it compares.
    """

    enf_method: ClassVar[str]

    @abstractmethod
    def __call__(
        self, hypotheses: Hypotheses, grids: Sequence[Grid], settings: MatchSettings
    ) -> Finding:
        """Compare."""


class OneReferenceMatcher(Protocol):
    """A method that knows one reference only, and a claim as a lag in it."""

    def __call__(
        self, track: Track, grid: Grid, settings: MatchSettings, claimed_lag_s: float = NAN
    ) -> Finding:
        """Compare; a claimed lag is looked at as well, where given."""
        ...


def one_reference(match: OneReferenceMatcher, name: str) -> Matcher:
    """Make a matcher of a method that knows one reference only."""

    def matcher(
        track: Track,
        grids: Sequence[Grid],
        settings: MatchSettings,
        claimed_utc_ns: int = 0,
    ) -> Finding:
        if len(grids) != 1:
            raise UsageError(
                f"method {name!r} compares with one reference, not {len(grids)}",
                "give one, or use the method phase",
            )
        found = match(track, grids[0], settings, claimed_lag_s(grids[0], claimed_utc_ns))
        return replace(found, grid=grids[0])

    return matcher


def compare_directions(
    compare: Callable[[Track], Finding], track: Track, tolerance_s: float
) -> tuple[Finding, Track]:
    """Compare a track, and its mirror image where the direction of read-out isn't known.

    That makes the search twice as large, which the matchers count (:attr:`Track.hypotheses`).

    Returns
    -------
    finding : Finding
        Of the direction that fits better.
    track : Track
        What it rests on.
    """
    if track.directions == 1:
        return compare(track), track
    tried = [(compare(one), one) for one in (track, track.mirrored())]
    (best, own), (other, _) = sorted(tried, key=lambda one: -one[0].log10_lr_absent)
    against_other = best.log10_lr
    if abs(best.lag_s - other.lag_s) > tolerance_s:
        against_other = min(against_other, best.log10_lr_absent - other.log10_lr_absent)
    way = "the direction assumed" if own is track else "the other direction"
    found = replace(
        best,
        log10_lr=against_other,
        search_size=best.search_size + other.search_size,
        claim_log10_lr=_mean(best.claim_log10_lr, other.claim_log10_lr),
        claim_log10_lr_other=_mean(best.claim_log10_lr_other, other.claim_log10_lr_other),
        verbal=verbal(min(against_other, best.log10_lr_absent)) if best.verbal else "",
        warnings=(
            *best.warnings,
            "the direction of read-out isn't known, and with it the sign of the ENF's deviation: "
            f"both were compared, and {way} fits better",
        ),
    )
    if "match" == best.decision == other.decision and against_other < best.log10_lr:
        reason = "one time fits for each direction of read-out"
        found = replace(found, decision="no_decision", reason=reason)
    return found, own


def _mean(*log10_lr: float) -> float:
    """Mean of likelihood ratios, those that are known."""
    known = [one for one in log10_lr if not math.isnan(one)]
    if not known:
        return math.nan
    top = max(known)
    return top + math.log10(sum(10.0 ** (one - top) for one in known) / len(known))


def claimed_lag_s(grid: Grid, claimed_utc_ns: int) -> float:
    """Lag that a claimed start means; NaN without a claim or when the reference has no time."""
    if not claimed_utc_ns or not grid.t0_ns:
        return math.nan
    return seconds(claimed_utc_ns - grid.t0_ns)


def start_ns(grid: Grid, lag_s: float) -> int:
    """Start that a lag means, UTC since 1970; 0 when it or the reference's isn't known."""
    return grid.t0_ns + nanoseconds(lag_s) if grid.t0_ns and not math.isnan(lag_s) else 0


def moment(grid: Grid, lag_s: float) -> str:
    """Say when a lag is: UTC where the reference's is known."""
    return utc_text(start_ns(grid, lag_s)) or f"{lag_s:.1f} s into the reference"


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


def nothing_to_decide(track: Track, grids: Sequence[Grid], settings: MatchSettings) -> str:
    """Say why these can't be compared at all; empty when they can."""
    usable_s = track.usable * track.hop_s
    if not track.usable:
        return "no usable signal"
    if wrong_speed := off_speed(track, of_nominal(track, grids)):
        return wrong_speed
    if usable_s < settings.min_seconds:
        return f"only {usable_s:g} usable seconds of ENF; at least {settings.min_seconds:g} needed"
    if not of_nominal(track, grids):
        return (
            f"the light follows a {track.nominal_hz:.0f} Hz grid, "
            f"the reference is of a {grids[0].nominal_hz:.0f} Hz one"
        )
    return ""


def of_nominal(track: Track, grids: Sequence[Grid]) -> list[Grid]:
    """Return the references of grids with the nominal frequency that the light follows."""
    return [grid for grid in grids if abs(track.nominal_hz - grid.nominal_hz) < NEAR_HZ]


def off_speed(track: Track, grids: Sequence[Grid]) -> str:
    """Say that the clip's ENF is too far from the nominal one; empty where it isn't."""
    enf_hz = float(np.nanmedian(track.enf_hz))
    away_hz = enf_hz - track.nominal_hz
    if abs(away_hz) <= FARTHEST_HZ or any(_comes_near(grid, enf_hz) for grid in grids):
        return ""
    percent = abs(away_hz) / track.nominal_hz * 100
    return (
        f"the clip's ENF is {abs(away_hz):.2f} Hz ({percent:.1f} %) "
        f"{'above' if away_hz > 0 else 'below'} {track.nominal_hz:g} Hz, where the reference never "
        "is: played at another speed, or wrong frame times?"
    )


def _comes_near(grid: Grid, enf_hz: float) -> bool:
    pieces = (grid.freq_hz[k : k + PIECE] for k in range(0, grid.freq_hz.size, PIECE))
    return any((np.abs(piece - enf_hz) < BESIDE_HZ).any() for piece in pieces)
