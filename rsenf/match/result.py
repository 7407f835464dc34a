"""Makes the match message from a finding: absolute times, the claim, and warnings."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from rsenf.match.matcher import Finding, claimed_lag_s, moment, start_ns
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Header, MatchResult

NAN = float("nan")
UNUSUAL_CLOCK = 4.3  # in units of ``clock_scale_ppm``
HOUR_S = 3600.0
QUARTERS_FROM_H = 3.0  # zones that are off by half or quarter hours are at least this far from UTC
LAST_ZONE_H = 14


def result_of(
    finding: Finding,
    *,
    header: Header,
    method: str,
    grid: Grid,
    track: Track | None,
    jumps: int,
    settings: MatchSettings,
    claimed_utc_ns: int,
    is_later: bool,
    final: bool,
) -> MatchResult:
    """Make the message of a finding.

    Parameters
    ----------
    finding : Finding
    header : Header
    method : str
    grid : Grid
        Reference of the finding, or the first one.
    track : Track or None
    jumps : int
        Number of outliers left out of the track.
    settings : MatchSettings
    claimed_utc_ns : int
        Claimed start, UTC since 1970; 0 for none.
    is_later : bool
        Whether the source restarted, so that the claim is of an earlier stretch.
    final : bool
        Whether the clip is complete.
    """
    claim_lag_s = math.nan if is_later else claimed_lag_s(grid, claimed_utc_ns)
    candidates = tuple(
        c
        if c.grid
        else dataclasses.replace(c, grid=grid.name, start_utc_ns=start_ns(grid, c.lag_s))
        for c in finding.candidates
    )
    jumped = [f"estimates that jump away from their neighbours, left out: {jumps}"] if jumps else []
    others = _warnings(finding, grid, track, claim_lag_s, claimed_utc_ns, settings)
    others += ["the source restarted: the claim is of its first stretch, not of this"] * is_later
    shared = MatchResult.__dataclass_fields__.keys() - {"grid", "candidates", "warnings"}
    found: dict[str, Any] = {name: v for name, v in vars(finding).items() if name in shared}
    return MatchResult(
        header=header,
        method=method,
        grid=grid.name,
        start_utc_ns=start_ns(grid, finding.lag_s),
        claim=_claim(finding, claim_lag_s, grid, settings) if claimed_utc_ns else "",
        claimed_utc_ns=claimed_utc_ns,
        final=final,
        candidates=candidates,
        zone_unknown=grid.zone_unknown,
        warnings=(*jumped, *finding.warnings, *others),
        **found,
    )


def _claim(finding: Finding, claim_lag_s: float, grid: Grid, settings: MatchSettings) -> str:
    """Decide on a claim, by the match or by the claim's own likelihood ratios and fit."""
    if math.isnan(claim_lag_s):
        return "undecidable"
    if finding.decision == "match":
        if abs(finding.lag_s - claim_lag_s) <= settings.tolerance_s:
            return "supported"
        hours = _zone_hours(finding.lag_s - claim_lag_s, settings.tolerance_s)
        return "undecidable" if grid.zone_unknown and hours else "refuted"
    limit = settings.min_log10_lr
    if min(finding.claim_log10_lr, finding.claim_log10_lr_other) >= limit:
        return "supported"
    misfit = finding.claim_fit < settings.min_fit or finding.claim_log10_lr <= -limit
    return "refuted" if misfit and not grid.zone_unknown else "undecidable"


def _warnings(
    finding: Finding,
    grid: Grid,
    track: Track | None,
    claim_lag_s: float,
    claimed_utc_ns: int,
    settings: MatchSettings,
) -> list[str]:
    out = []
    if claimed_utc_ns and not grid.t0_ns:
        out.append("the reference's start time isn't known, so the claim can't be tested")
    if claimed_utc_ns and grid.zone_unknown:
        out.append(
            "the reference's times tell no zone (--timezone): the claim was tried as if they were "
            "UTC, and a difference of time zones can't refute it"
        )
    if track is not None and _outside(grid, track, claim_lag_s, settings):
        out.append(
            "the claimed start lies outside of the reference, which lasts from "
            f"{moment(grid, 0.0)} to {moment(grid, grid.duration_s)}"
        )
    if finding.coverage_ratio < 0.995:
        out.append(
            f"{1 - finding.coverage_ratio:.1%} of the possible times fall into gaps of the "
            "reference and could not be compared"
        )
    if track is None or math.isnan(finding.lag_s):
        return out
    missed_s = track.usable * track.hop_s - finding.seconds_used
    if missed_s >= track.hop_s and not finding.segments:
        out.append(f"{missed_s:g} usable seconds of the clip have no reference at the best time")
    is_match = finding.decision == "match"
    if is_match and abs(finding.clock_ppm) > UNUSUAL_CLOCK * settings.clock_scale_ppm:
        out.append(
            f"a clock error of {finding.clock_ppm:.0f} ppm is unusual for a camera: wrong frame "
            "times? 30 and 29.97 frames/s differ by 1000 ppm"
        )
    hours = _zone_hours(finding.lag_s - claim_lag_s, settings.tolerance_s)
    if is_match and hours:
        out.append(f"the claim is off by just {hours:+g} h: a time zone or daylight saving?")
    return out


def _outside(grid: Grid, track: Track, claim_lag_s: float, settings: MatchSettings) -> bool:
    """Whether too little of a clip with the claimed start would lie within the reference."""
    length_s = track.first_s + track.enf_hz.size * track.hop_s
    inside_s = min(claim_lag_s + length_s, grid.duration_s) - max(claim_lag_s, 0.0)
    return inside_s < settings.min_overlap * length_s


def _zone_hours(difference_s: float, tolerance_s: float) -> float:
    """Return a difference as hours between time zones; 0 if it isn't one."""
    if math.isnan(difference_s):
        return 0.0
    hours = round(4 * difference_s / HOUR_S) / 4
    near = abs(difference_s - hours * HOUR_S) <= tolerance_s
    usual = hours.is_integer() or abs(hours) >= QUARTERS_FROM_H
    return hours if near and usual and abs(hours) <= LAST_ZONE_H else 0.0
