"""The matcher ``ncc``: masked normalised cross-correlation at all lags, decided by evidence.

The correlation at every lag is also the curve that a report shows, whatever the matcher decides by,
because a layman can read it. It comes in pieces, so that a year of lags is never in memory; the
caller keeps what a picture can show.

Model: at the true lag the clip's ENF is the reference's plus a constant (the clock) and Gaussian
residuals of variance ``V``, one independent value per half resolution (:mod:`rsenf.match.score`).

Statistic: ``−½·(n − 1)·log(V/V_0) − ½·(ν + 1)·log(1 + (ppm/scale)²/ν)`` at every lag, ``V_0`` that
of an ordinary lag and ``ν = 3``; decided by its distance from the second best, the number of wrong
lags that would fit as well, and an F test of ``V`` (:mod:`rsenf.match.search`).

Approximate: a fixed number of independent values in a second; wrong lags have an exponential tail.

References
----------
- Huijbregtse, M. and Geradts, Z. (2009), Using the ENF criterion for determining the time of
  recording of short digital audio recordings, Computational Forensics, LNCS 5718.
- Padfield, D. (2012), Masked object registration in the Fourier domain, IEEE Trans. Image
  Processing 21(5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from rsenf.match.matcher import NOTHING_SHARED, Finding, claimed_lag_s, not_found, the_only
from rsenf.match.score import PIECE, Peak, independent_values
from rsenf.match.search import (
    USUAL_WINDOW_S,
    Evidence,
    Search,
    fit_of,
    prepared,
    search,
    verbal,
    weigh,
)
from rsenf.match.series import Grid, Track
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate
from rsenf.messages.schema import FloatArray


def matcher_ncc(
    track: Track, grids: Sequence[Grid], settings: MatchSettings, claimed_utc_ns: int = 0
) -> Finding:
    """Compare a track with the one reference given; a :class:`rsenf.match.matcher.Matcher`.

    Raises
    ------
    UsageError
        If there are several references, or as :func:`match_ncc`.
    """
    grid = the_only(grids, "ncc")
    return replace(match_ncc(track, grid, settings, claimed_lag_s(grid, claimed_utc_ns)), grid=grid)


def match_ncc(
    track: Track, grid: Grid, settings: MatchSettings, claimed_lag_s: float = math.nan
) -> Finding:
    """Search the reference for the clip and weigh the best lag (Huijbregtse and Geradts 2009).

    A blind search of a day finds a wrong lag with a correlation above 0.94 for most short clips, so
    the decision rests on the tests of :mod:`rsenf.match.search`, not on a threshold.

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
            decision="no_decision", reason=NOTHING_SHARED, coverage_ratio=found.coverage_ratio
        )
    best, evidence = found.peaks[0], weigh(found, track, settings)
    lag_std_s, offset_std_hz = _errors(best, track.resolution_s)
    decision, reason = _decide(found, evidence, lag_std_s, settings)
    values = independent_values(best.seconds, track.resolution_s)
    has_claim = not math.isnan(claimed_lag_s)
    claimed = found.near(claimed_lag_s, settings.tolerance_s) if has_claim else None
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
        claim_fit=fit_of(claimed, found, track, settings)[0] if claimed else math.nan,
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
        return not_found(found.coverage_ratio)
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


@dataclass(frozen=True, eq=False)
class LagScores:
    """Scores of some lags; larger is better."""

    # (n,) start of the clip less the start of the reference's first sample; rising
    lag_s: FloatArray
    score: FloatArray  # (n,) NaN where the two could not be compared
    name: str  # name of the score and how to read it, such as ``correlation`` and ``1 is perfect``
    unit: str


def lag_scores(
    track: Track, grid: Grid, settings: MatchSettings, best_lag_s: float
) -> Iterator[LagScores]:
    """Yield the correlation at every lag, with the smoothing that fits best (Padfield 2012).

    Parameters
    ----------
    track : Track
        As the matcher saw it, without outliers.
    grid : Grid
    settings : MatchSettings
    best_lag_s : float
        The lag that the matcher found; the smoothing is the one that fits best there.

    Yields
    ------
    LagScores
        Lags rise within a piece. Pieces may overlap or interleave; the best score of a lag counts.
    """
    way = 0
    for part in _parts(track, grid):
        if part.first_lag_s <= best_lag_s < part.last_lag_s:
            way = _best_way(track, part.grid, settings, best_lag_s - part.begin_s)
    for part in _parts(track, grid):
        ((_, scorers),) = islice(prepared(track, part.grid, settings), way, way + 1)
        for scorer in scorers:
            for table in scorer.tables():
                lag_s = scorer.lags_s(table.lags) + part.begin_s
                in_piece = (lag_s >= part.first_lag_s) & (lag_s < part.last_lag_s)
                if in_piece.any():
                    score = table.correlation[in_piece]
                    yield LagScores(lag_s[in_piece], score, "correlation", "1 is perfect")


class _Part(NamedTuple):
    """A part of a reference, its start, and the range of lags that are reported from it."""

    grid: Grid
    begin_s: float
    first_lag_s: float
    last_lag_s: float


def _parts(track: Track, grid: Grid) -> Iterator[_Part]:
    """Cut a reference into parts that overlap by a clip and the longest window on either side."""
    per_hop = max(round(track.hop_s / grid.step_s), 1)  # a part holds whole hops
    clip_s = track.enf_hz.size * track.hop_s + track.window_s + USUAL_WINDOW_S
    reach = math.ceil(clip_s / grid.step_s / per_hop) * per_hop
    piece = PIECE // per_hop * per_hop
    size = grid.freq_hz.size
    for start in range(0, size, piece):
        a, b = max(start - reach, 0), min(start + piece + reach, size)
        yield _Part(
            replace(grid, freq_hz=np.asarray(grid.freq_hz[a:b])),
            a * grid.step_s,
            start * grid.step_s if start else -math.inf,
            (start + piece) * grid.step_s if start + piece < size else math.inf,
        )


def _best_way(track: Track, grid: Grid, settings: MatchSettings, lag_s: float) -> int:
    """Return the index of the smoothing (:func:`rsenf.match.search.ways`) that fits best."""
    best = []
    for _, scorers in prepared(track, grid, settings):
        scores = [scorer.peak(scorer.nearest_lag(lag_s)).score for scorer in scorers]
        best.append(max((s for s in scores if not math.isnan(s)), default=-math.inf))
    return best.index(max(best))
