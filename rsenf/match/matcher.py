"""The matcher interface: a track and references in, a finding out; the same for all methods."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from rsenf.errors import UsageError
from rsenf.match.paper_search import Hypotheses
from rsenf.match.search import verbal
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate, Edit, Segment
from rsenf.timebase import nanoseconds, seconds, utc_text

NEAR_HZ = 0.5  # nominal frequencies nearer than this are the same

# A grid is further than FARTHEST_HZ from its nominal frequency only for minutes in many years; then
# the reference must come within BESIDE_HZ of the clip's ENF.
FARTHEST_HZ, BESIDE_HZ = 0.1, 0.02
PIECE = 1 << 20  # samples of a reference read together
NAN = float("nan")
ENOUGH_COVERAGE = 0.5  # share of the possible lags needed to conclude "not in this reference"
NOTHING_SHARED = "at no time do the clip and the reference share enough valid seconds"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The conclusion of a matcher, with lags on the reference's axis; NaN where undetermined.

    The fields are those of :class:`rsenf.messages.MatchResult`. In addition, ``grid`` is the
    reference of the lag, ``claim_fit`` the probability of so large a residual at the claimed start
    if it is the true one, and ``coverage_ratio`` the share of the possible lags that could be
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
    """A method that compares one track with references."""

    def __call__(
        self, track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int = 0
    ) -> Finding:
        """Compare; also test the claimed start (ns UTC since 1970), unless it is 0."""
        ...


class HypothesisMatcher(ABC):
    """A method that compares all hypotheses of an ENF method instead of one track.

    Attributes
    ----------
    enf_method : str
        Name of that ENF method.
    """

    enf_method: ClassVar[str]

    @abstractmethod
    def __call__(
        self, hypotheses: Hypotheses, grids: Sequence[Grid], settings: MatchSettings
    ) -> Finding:
        """Compare all hypotheses with the references."""


def the_only(grids: Sequence[Grid], method: str) -> Grid:
    """Return the reference of a method that compares with one; UsageError for any other number."""
    if len(grids) != 1:
        raise UsageError(
            f"method {method!r} compares with one reference, not {len(grids)}",
            "give one, or use the method phase",
        )
    return grids[0]


def compare_directions(
    compare: Callable[[Track], Finding], track: Track, tolerance_s: float
) -> tuple[Finding, Track]:
    """Compare a track, and its mirror image if the read-out direction is unknown.

    That doubles the size of the search, which the matchers count (:attr:`Track.hypotheses`).

    Parameters
    ----------
    compare : callable
        Compares one track.
    track : Track
    tolerance_s : float
        Lags of the two directions that differ by more compete with each other.

    Returns
    -------
    finding : Finding
        Of the direction that fits better.
    track : Track
        The track in that direction.
    """
    if track.directions == 1:
        return compare(track), track
    tried = [(compare(one), one) for one in (track, track.mirrored())]
    (best, better), (other, _) = sorted(tried, key=lambda one: -one[0].log10_lr_absent)
    against_other = best.log10_lr
    if best.grid is not other.grid or abs(best.lag_s - other.lag_s) > tolerance_s:
        against_other = min(against_other, best.log10_lr_absent - other.log10_lr_absent)
    way = "the direction assumed" if better is track else "the other direction"
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
    return found, better


def _mean(*log10_lr: float) -> float:
    """Log of the mean of the likelihood ratios that are not NaN."""
    known = [one for one in log10_lr if not math.isnan(one)]
    if not known:
        return math.nan
    top = max(known)
    return top + math.log10(sum(10.0 ** (one - top) for one in known) / len(known))


def claimed_lag_s(grid: Grid, claimed_utc_ns: int) -> float:
    """Return the lag of a claimed start; NaN without a claim or a known start of the reference."""
    if not claimed_utc_ns or not grid.t0_ns:
        return math.nan
    return seconds(claimed_utc_ns - grid.t0_ns)


def start_ns(grid: Grid, lag_s: float) -> int:
    """Return the start at a lag, ns UTC since 1970; 0 if it or the reference's time is unknown."""
    return grid.t0_ns + nanoseconds(lag_s) if grid.t0_ns and not math.isnan(lag_s) else 0


def moment(grid: Grid, lag_s: float) -> str:
    """Return the time at a lag as text: UTC if known, else seconds into the reference.

    Examples
    --------
    >>> moment(Grid("mains", 50.0, 0, 1.0, np.zeros(60)), 12.34)
    '12.3 s into the reference'
    """
    return utc_text(start_ns(grid, lag_s)) or f"{lag_s:.1f} s into the reference"


def nothing_to_decide(track: Track, grids: Sequence[Grid], settings: MatchSettings) -> str:
    """Return the reason why a clip and references can't be compared at all; empty if they can."""
    if not track.usable:
        return "no usable signal"
    if wrong_speed := off_speed(track, of_nominal(track, grids)):
        return wrong_speed
    if short := too_short(track.usable * track.hop_s, settings):
        return short
    if not of_nominal(track, grids):
        return (
            f"the light follows a {track.nominal_hz:.0f} Hz grid, "
            f"the reference is of a {grids[0].nominal_hz:.0f} Hz one"
        )
    return ""


def too_short(usable_s: float, settings: MatchSettings) -> str:
    """Return a text if a clip has too few usable seconds for a decision; empty if it has enough."""
    if usable_s < settings.min_seconds:
        return f"only {usable_s:g} usable seconds of ENF; at least {settings.min_seconds:g} needed"
    return ""


def not_found(coverage_ratio: float) -> tuple[str, str]:
    """Return decision and reason if no time fits: only a search of enough times tells ``no_match``.

    Parameters
    ----------
    coverage_ratio : float
        Share of the possible lags that could be compared.
    """
    if coverage_ratio < ENOUGH_COVERAGE:
        return "no_decision", (
            f"no time fits, but only {coverage_ratio:.0%} of the times could be compared"
        )
    return "no_match", "no time in this reference fits the clip"


def of_nominal(track: Track, grids: Sequence[Grid]) -> list[Grid]:
    """Return the references whose nominal frequency is that of the track."""
    return [grid for grid in grids if abs(track.nominal_hz - grid.nominal_hz) < NEAR_HZ]


def off_speed(track: Track, grids: Sequence[Grid]) -> str:
    """Return a text if the clip's ENF is too far from its nominal frequency; empty if it isn't."""
    enf_hz = float(np.nanmedian(track.enf_hz))
    away_hz = enf_hz - track.nominal_hz
    pieces = (g.freq_hz[k : k + PIECE] for g in grids for k in range(0, g.freq_hz.size, PIECE))
    if abs(away_hz) <= FARTHEST_HZ or any(np.any(np.abs(p - enf_hz) < BESIDE_HZ) for p in pieces):
        return ""
    percent = abs(away_hz) / track.nominal_hz * 100
    return (
        f"the clip's ENF is {abs(away_hz):.2f} Hz ({percent:.1f} %) "
        f"{'above' if away_hz > 0 else 'below'} {track.nominal_hz:g} Hz, where the reference never "
        "is: played at another speed, or wrong frame times?"
    )
