"""The matcher ``ncc``: masked normalised cross-correlation at all lags, decided by evidence."""

from __future__ import annotations

import math

from rsenf.match.evidence import Evidence, fit_of, verbal, weigh
from rsenf.match.matcher import ENOUGH_COVERAGE, Finding
from rsenf.match.score import Peak, independent_values
from rsenf.match.search import Search, search
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate


def match_ncc(
    track: Track, grid: Grid, settings: MatchSettings, claimed_lag_s: float = math.nan
) -> Finding:
    """Search the reference for the clip and weigh the best lag.

    A blind search of a day finds a wrong lag with a correlation above 0.94 for most short clips, so
    the decision rests on the tests of :mod:`rsenf.match.evidence`, not on a threshold.

    Parameters
    ----------
    track : Track
    grid : Grid
    settings : MatchSettings
    claimed_lag_s : float, optional
        Lag of a claimed start, whose fit is tested too.

    Raises
    ------
    UsageError
        If neither time step is a whole multiple of the other.
    """
    found = search(track, grid, settings)
    if not found.peaks:
        return Finding(
            decision="no_decision",
            reason="at no time do the clip and the reference share enough valid seconds",
            coverage_ratio=found.coverage_ratio,
        )
    best, evidence = found.peaks[0], weigh(found, track, settings)
    lag_std_s, offset_std_hz = _errors(best, track.resolution_s)
    decision, reason = _decide(found, evidence, lag_std_s, settings)
    values = independent_values(best.seconds, track.resolution_s)
    return Finding(
        decision=decision,
        reason=reason,
        lag_s=best.lag_s,
        lag_std_s=lag_std_s,
        correlation=best.correlation,
        log10_lr=evidence.log10_lr,
        log10_lr_absent=evidence.log10_lr_absent,
        clock_ppm=-best.offset_hz / track.nominal_hz * 1e6,
        clock_std_ppm=offset_std_hz / track.nominal_hz * 1e6,
        residual_std_hz=math.sqrt(best.residual_var_hz2 * values / max(values - 1.0, 0.5)),
        expected_std_hz=math.sqrt(evidence.expected_var_hz2),
        seconds_used=best.seconds,
        search_size=found.lags,
        coverage_ratio=found.coverage_ratio,
        claim_fit=_claim_fit(found, track, settings, claimed_lag_s),
        verbal=verbal(min(evidence.log10_lr, evidence.log10_lr_absent)),
        candidates=_candidates(found, track, settings.candidates),
    )


def _decide(
    found: Search, evidence: Evidence, lag_std_s: float, settings: MatchSettings
) -> tuple[str, str]:
    """Return the decision and its reason."""
    fits = evidence.fit >= settings.min_fit
    stands_out = evidence.chance <= settings.max_chance
    unique = evidence.log10_lr >= settings.min_log10_lr
    if not found.peaks[1:]:
        return "no_decision", "the reference leaves no other time to compare the best one with"
    if fits and stands_out and unique:
        if not lag_std_s <= settings.tolerance_s:  # NaN if the peak has no curvature
            return "no_decision", (
                "one time stands out, but its place is uncertain by over "
                f"{settings.tolerance_s:g} s"
            )
        how = found.way.text
        return "match", f"one time fits, and no other nearly as well (reference {how})"
    if stands_out and not fits:
        return "no_decision", "the best time fits better than chance, but not as well as it should"
    if not fits:
        if found.coverage_ratio < ENOUGH_COVERAGE:
            return "no_decision", (
                f"no time fits, but only {found.coverage_ratio:.0%} of the times could be compared"
            )
        return "no_match", "no time in this reference fits the clip"
    if not unique:
        return "no_decision", "several times fit about equally well"
    return "no_decision", (
        f"a search this large finds {evidence.chance:.2g} fits this good by chance"
    )


def _errors(best: Peak, resolution_s: float) -> tuple[float, float]:
    """Standard errors of the lag (s) and of the frequency offset (Hz), by least squares.

    The residual variance rises by ``bend · δ²`` at a distance ``δ`` from its minimum ``V``; with
    ``n`` independent values the lag's variance is ``V / (n · bend)``.
    """
    values = max(independent_values(best.seconds, resolution_s), 1.0)
    offset_std = math.sqrt(best.residual_var_hz2 / values)
    if best.bend_hz2_per_s2 <= 0.0:
        return math.nan, offset_std
    return offset_std / math.sqrt(best.bend_hz2_per_s2), offset_std


def _claim_fit(found: Search, track: Track, settings: MatchSettings, claimed_lag_s: float) -> float:
    if math.isnan(claimed_lag_s):
        return math.nan
    peak = found.near(claimed_lag_s, settings.tolerance_s)
    return fit_of(peak, found, track, settings)[0] if peak else math.nan


def _candidates(found: Search, track: Track, count: int) -> tuple[Candidate, ...]:
    """Return the best peaks, each with its likelihood ratio against the best of the others."""
    peaks = found.peaks
    return tuple(
        Candidate(
            lag_s=p.lag_s,
            correlation=p.correlation,
            clock_ppm=-p.offset_hz / track.nominal_hz * 1e6,
            log10_lr=(p.score - peaks[1 if i == 0 else 0].score) / math.log(10.0)
            if len(peaks) > 1
            else math.nan,
            seconds_used=p.seconds,
        )
        for i, p in enumerate(peaks[:count])
    )
