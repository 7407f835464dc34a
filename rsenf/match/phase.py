"""The matcher ``phase``: compares the clip's phase with the reference's integrated frequency.

Model: at the true lag the clip's phase less the predicted phase is a random walk, a bounded wander,
noise and a constant frequency offset (the clock), see :mod:`rsenf.match.phase_filter`.

Likelihood: ``LR(lag) = p(phases | lag) / p(phases | any grid)`` (:mod:`rsenf.match.phase_scorer`),
integrated over the peak, with the search space as a uniform prior: against the sum over all other
places, and against a time in none of the references. A claimed time is weighed without the search.

Approximate: peaks are Gaussian, and sizes of errors a mixture of fixed ones; so the ratios are
calibrated on real grids, and limited by their number (:mod:`rsenf.match.calibration`). Evidence
against a time is limited by the probability that the estimates follow no grid at all.

References
----------
- Schweppe, F. C. (1965), Evaluation of likelihood functions for Gaussian signals, IEEE Trans.
  Information Theory 11.
- ENFSI (2015), Guideline for evaluative reporting in forensic science: the verbal scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rsenf.match.calibration import calibration
from rsenf.match.clip_phase import RAD_PER_CYCLE, ClipPhase, clip_phase
from rsenf.match.matcher import NOTHING_SHARED, Finding, claimed_lag_s, not_found, start_ns
from rsenf.match.ou_likelihood import (
    BAD_SHARE,
    generic_log_likelihood,
    inliers,
    no_grid_log_likelihood,
    stretches,
)
from rsenf.match.phase_scorer import Clock, PhaseScorer
from rsenf.match.phase_search import APART_S, PhaseSearch, Place, refined, search_phase
from rsenf.match.score import LagScorer, Peak
from rsenf.match.search import verbal
from rsenf.match.series import Grid, Track, phases, to_step_of
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate

LN10 = math.log(10.0)
# Prior probability that a clip's estimates follow no grid, whatever their stated errors.
NO_GRID_SHARE = 0.1
# Frequency errors of real cameras are twice their stated size, and in a tenth of the clips five
# times, with a power-law tail (exponent 2). Wander of a grid within a minute (Hz).
LARGE_SHARE, LARGE_RATIO = 0.1, 5.0
GRID_WANDER_HZ = 0.013
LEAST_OF_FITTING = -1.0  # log10, for a time that fits better than any grid
SURE_STDS = 2.5  # standard errors of a match's lag that must be within the tolerance
NO_FIT = "no time fits, but the clip isn't shown to follow any grid well enough to exclude one"
NO_EXCLUSION = (
    "evidence against a time is capped: a grid's course explains these estimates hardly better "
    "than errors do"
)
CLAIM_STEP_S = 0.25  # between the lags at which a claim is tested


@dataclass(frozen=True)
class Raw:
    """Uncalibrated log10 likelihood ratios of the best place, with the search space as prior."""

    other: float
    absent: float


def match_phase(
    track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int = 0
) -> Finding:
    """Search references for the clip by its phase, and weigh the best time (Schweppe 1965).

    The best time is weighed against two alternatives: another time in these references, and a time
    in none of them. The size of the search counts against it in both. A claimed time is weighed on
    its own, without a penalty for the search.

    Parameters
    ----------
    track : Track
        With a phase, see :func:`rsenf.match.clip_phase.clip_phase`.
    grids : sequence of Grid
    settings : MatchSettings
    claimed_utc_ns : int
        Claimed start, UTC since 1970; 0 for none.

    Raises
    ------
    UsageError
        If neither of the steps of track and reference is a whole multiple of the other.
    """
    whole = clip_phase(track)
    assert whole is not None  # the stage uses ``ncc`` for estimates without a phase
    clip = whole.only(inliers(whole))
    found = search_phase(track, clip, grids, settings)
    if not found.places:
        return Finding(
            decision="no_decision", reason=NOTHING_SHARED, coverage_ratio=found.coverage_ratio
        )
    raw, lines, least = weigh(found), calibration(), least_log10_lr(whole)
    best = found.places[0]
    claims = _claims(found, grids, settings, claimed_utc_ns)
    claim, claim_other = (max(lines.claim(claim), least) for claim in claims)
    other, fits = lines.other(raw.other), lines.absent(raw.absent)
    absent = max(fits, least, least_of_best(best.score))
    clocks = found.clocks(found.places[: max(settings.candidates, 1)])
    decision, reason = _decide(found, other, absent, settings)
    warnings = []
    if missing_s := (whole.size - clip.size) * whole.hop_s:
        warnings.append(f"{missing_s:g} seconds follow no grid's course, and count for nothing")
    if -settings.min_log10_lr < least and min(fits, *map(lines.claim, claims)) < least:
        warnings.append(NO_EXCLUSION)
        reason = NO_FIT if absent == least else reason
    return Finding(
        decision=decision,
        reason=reason,
        grid=grids[best.grid],
        lag_s=best.lag_s,
        lag_std_s=best.lag_std_s,
        log10_lr=other,
        log10_lr_absent=absent,
        claim_log10_lr=claim,
        claim_log10_lr_other=claim_other,
        search_size=found.lags,
        coverage_ratio=found.coverage_ratio,
        verbal=verbal(min(other, absent)),
        candidates=_candidates(found, clocks, track, clip, grids, settings),
        warnings=tuple(warnings),
        **_fit(best, clocks[best], grids[best.grid], track, settings),
    )


def least_log10_lr(clip: ClipPhase) -> float:
    """Return the lower bound of the log10 likelihood ratio of any time, set by the clip itself.

    Estimates that follow no grid are equally likely at all times. So the evidence against a time
    can't exceed the evidence that they do follow a grid: the likelihood ratio of any grid against
    none over the clip, limited by the prior probability that errors of frequencies are as large as
    a grid's wander.
    """
    is_inlier = inliers(clip)
    bad = sum(not is_inlier[first] for first, _ in stretches(clip))
    kept = clip.only(is_inlier)
    shown = generic_log_likelihood(kept, robust=True) - no_grid_log_likelihood(kept)
    odds = float(shown[1:] @ kept.linked[1:]) + bad * math.log(BAD_SHARE)
    no_grid = -float(np.logaddexp(0.0, odds + math.log(1.0 / NO_GRID_SHARE - 1.0)))
    return min(float(np.logaddexp(no_grid, _log_share_of_grid_like_errors(kept))), 0.0) / LN10


def least_of_best(score: float) -> float:
    """Return the lower bound of the log10 likelihood ratio against all times, from the best score.

    A time that fits better than any grid need not be the true one in a large search, but it isn't
    excluded either: with slightly larger errors it would have stood out.
    """
    return LEAST_OF_FITTING if score > 0.0 else -math.inf


def _log_share_of_grid_like_errors(clip: ClipPhase) -> float:
    """Log prior probability that errors of frequencies are as large as a grid's own wander.

    Minus infinity for measured phases, whose errors don't accumulate.
    """
    if not clip.is_summed:
        return -math.inf
    std_rad = float(np.sqrt(np.median(clip.walk_rad2[clip.walk_rad2 > 0.0])))
    ratio = RAD_PER_CYCLE * clip.hop_s * GRID_WANDER_HZ / std_rad
    return math.log(LARGE_SHARE) + 2.0 * math.log(LARGE_RATIO / ratio)


def weigh(found: PhaseSearch) -> Raw:
    """Weigh the best place of a search; the search must have one."""
    best, span = found.places[0], math.log(max(found.span_s, 1.0))
    return Raw(
        other=(best.weight - _together(found.places[1:], span)) / LN10,
        absent=(best.weight - span) / LN10,
    )


def weigh_claim(
    found: PhaseSearch, number: int, lag_s: float, settings: MatchSettings
) -> tuple[float, float]:
    """Weigh a lag that was claimed, not searched for.

    Parameters
    ----------
    found : PhaseSearch
    number : int
        Index of the reference.
    lag_s : float
    settings : MatchSettings

    Returns
    -------
    against_absent, against_other : float
        Raw log10 likelihood ratios: against a time in none of the references, and against any
        other time in them; NaN if the lag can't be compared.
    """
    at = _claim_weight(found.scorers[number], number, lag_s, settings.tolerance_s)
    span = math.log(max(found.span_s, 1.0))
    elsewhere = [p for p in found.places if p.grid != number or abs(p.lag_s - lag_s) >= APART_S]
    return at / LN10, (at - _together(elsewhere, span) + span) / LN10


def _claims(
    found: PhaseSearch, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int
) -> tuple[float, float]:
    """Weigh a claimed start in the reference that it fits best; NaN without a claim."""
    lags = [claimed_lag_s(grid, claimed_utc_ns) for grid in grids]
    claims = [
        weigh_claim(found, number, lag_s, settings)
        for number, lag_s in enumerate(lags)
        if not math.isnan(lag_s)
    ]
    known = [claim for claim in claims if not math.isnan(claim[0])]
    return max(known, default=(math.nan, math.nan))


def _together(places: Sequence[Place], span: float) -> float:
    """Log of the summed likelihoods of places, with a floor of ``−span``."""
    return float(np.logaddexp.reduce([-span, *(p.weight for p in places)]))


def _claim_weight(scorer: PhaseScorer, number: int, lag_s: float, tolerance_s: float) -> float:
    """Log of the mean likelihood within the tolerance of a claimed lag (nats), or NaN."""
    at = lag_s + np.arange(-tolerance_s, tolerance_s + CLAIM_STEP_S / 2, CLAIM_STEP_S)
    score = scorer.scores(at)
    if not np.isfinite(score).any():
        return math.nan
    top = int(score.argmax())
    peak = refined(scorer, Place(number, float(at[top]), tolerance_s, float(score[top])))
    if abs(peak.lag_s - lag_s) > tolerance_s:
        return float(np.logaddexp.reduce(score) - math.log(at.size))
    return peak.score + math.log(min(peak.width_s / (2 * tolerance_s), 1.0))


def _decide(
    found: PhaseSearch, other: float, absent: float, settings: MatchSettings
) -> tuple[str, str]:
    """Return the decision and its reason."""
    best, limit = found.places[0], settings.min_log10_lr
    if absent >= limit and other >= limit:
        if SURE_STDS * best.lag_std_s > settings.tolerance_s:
            return "no_decision", (
                f"one time stands out, but it isn't known to {settings.tolerance_s:g} s: "
                f"± {best.lag_std_s:.2f} s"
            )
        return "match", "one time fits, and no other nearly as well"
    if absent <= -limit:
        return not_found(found.coverage_ratio)
    if absent >= limit:
        return "no_decision", "several times fit about equally well"
    return "no_decision", (
        "the best time fits hardly better than some time must in a search of this size"
    )


def _fit(
    best: Place, clock: Clock, grid: Grid, track: Track, settings: MatchSettings
) -> dict[str, Any]:
    """Return the clock error and the agreement of the two frequencies at a place."""
    peak = _compared(track, grid, best.lag_s, settings)
    var_hz2 = track.var_hz2[np.isfinite(track.var_hz2)]
    expected = float(var_hz2.mean()) + settings.reference_std_hz**2 if var_hz2.size else math.nan
    return {
        "clock_ppm": -clock.offset_hz / track.nominal_hz * 1e6,
        "clock_std_ppm": clock.offset_std_hz / track.nominal_hz * 1e6,
        "correlation": peak.correlation,
        "residual_std_hz": math.sqrt(peak.residual_var_hz2),
        "expected_std_hz": math.sqrt(expected),
        "seconds_used": peak.seconds,
    }


def _compared(track: Track, grid: Grid, lag_s: float, settings: MatchSettings) -> Peak:
    """Compare the frequencies at the nearest whole lag."""
    around = 4 * max(track.hop_s, grid.step_s)
    first = max(int((lag_s + track.first_s - around) / grid.step_s), 0)
    # Start at a whole hop if the reference has the finer step.
    per_hop = max(round(track.hop_s / grid.step_s), 1)
    first = first // per_hop * per_hop
    last = int((lag_s + track.first_s + track.enf_hz.size * track.hop_s + around) / grid.step_s) + 1
    part = to_step_of(
        track,
        Grid(grid.name, grid.nominal_hz, 0, grid.step_s, np.asarray(grid.freq_hz[first:last])),
    )
    peaks = []
    for thin in phases(track, part.step_s):
        scorer = LagScorer(thin, part.freq_hz, settings, 0.0)
        peaks.append(scorer.peak(scorer.nearest_lag(lag_s - first * grid.step_s)))
    return min(peaks, key=lambda p: abs(p.lag_s + first * grid.step_s - lag_s))


def _candidates(
    found: PhaseSearch,
    clocks: Mapping[Place, Clock],
    track: Track,
    clip: ClipPhase,
    grids: Sequence[Grid],
    settings: MatchSettings,
) -> tuple[Candidate, ...]:
    """Return the best places, each with its likelihood ratio against the best of the others."""
    out = []
    for i, place in enumerate(found.places[: settings.candidates]):
        others = found.places[1 if i == 0 else 0 :][:1]
        clock = clocks[place]
        peak = _compared(track, grids[place.grid], place.lag_s, settings)
        out.append(
            Candidate(
                lag_s=place.lag_s,
                correlation=peak.correlation,
                clock_ppm=-clock.offset_hz / track.nominal_hz * 1e6,
                log10_lr=(place.weight - others[0].weight) / LN10 if others else math.nan,
                seconds_used=peak.seconds,
                grid=grids[place.grid].name,
                start_utc_ns=start_ns(grids[place.grid], place.lag_s),
            )
        )
    return tuple(out)
