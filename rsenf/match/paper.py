"""The paper's Metrics 1 to 4: how a lag is chosen from the peaks of all hypotheses.

Model: under the right line and idle ratio (:mod:`rsenf.track.paper`) the clip's ENF at the true lag
is the reference's, up to an offset and a scale.

Statistic (paper, Section IV): the peak of the normalised cross-correlation ``ρ``. Metric 1 takes
it at ``f_0`` without an idle period, 2 at the best line without one, 3 at the best of all
hypotheses; 4 takes the group of lags with the largest ``√(n² + ρ²)`` (Eq. 25), ``n`` its number of
hypotheses, both divided by their maximum. A match is ``ρ > TH_c = 0.94`` by default.

Approximate: no distribution stands behind ``TH_c``. In a blind search of a day wrong times exceed
it too, so a match by a metric has no likelihood ratio, and the result says so.

References
----------
- Vatansever, S., Dirik, A. E. and Memon, N. (2019), Analysis of rolling shutter effect on ENF based
  video forensics, IEEE TIFS 14.
- Garg, R., Varna, A. L., Hajj-Ahmad, A. and Wu, M. (2013), "Seeing" ENF: power-signature-based
  timestamp for digital multimedia via optical sensing and signal processing, IEEE TIFS 8: Metric 1.
- Su, H., Hajj-Ahmad, A., Garg, R. and Wu, M. (2014), Exploiting rolling shutter for ENF signal
  extraction from video, ICIP: Metric 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsenf.match.matcher import (
    NOTHING_SHARED,
    Finding,
    HypothesisMatcher,
    the_only,
    too_short,
)
from rsenf.match.paper_search import Hypotheses, Label, Tally, paper_search
from rsenf.match.series import Grid
from rsenf.match.settings import MatchSettings
from rsenf.messages import Candidate

GROUP_S = 1.0  # lags within this distance of a lag form its group
NO_LR = (
    "decided by a threshold on the correlation alone, which wrong times of a long reference pass "
    "too: no likelihood ratio belongs to it"
)


def metric(tally: Tally, number: int) -> Finding:
    """Decide by one of the paper's metrics.

    Parameters
    ----------
    tally : Tally
    number : int
        1: the line at ``f_0`` without an idle period. 2: the best line without an idle period.
        3: the best of all hypotheses. 4: the lag that most hypotheses agree on, combined with the
        correlation (paper, Eq. 25).
    """
    allowed = np.array([_is_allowed(label, number) for label in tally.hypotheses.labels])
    peak = np.where(allowed, np.nan_to_num(tally.correlation, nan=-np.inf), -np.inf)
    size = tally.lags * int(allowed.sum())
    if not np.isfinite(peak).any():
        return Finding(decision="no_decision", reason=NOTHING_SHARED)
    threshold = tally.settings.threshold_correlation
    ranked = _by_agreement(tally, threshold) if number == 4 else np.argsort(-peak, kind="stable")
    ranked = [int(i) for i in ranked if peak[i] > threshold]
    best = ranked[0] if ranked else int(np.argmax(peak))
    label = tally.hypotheses.labels[best]
    idle = f"{label.idle_ratio:.0%} idle"
    if ranked:
        decision, reason = "match", f"over {threshold:g} at {label.line_hz:.1f} Hz with {idle}"
    else:
        decision, reason = "no_decision", f"no peak correlation above {threshold:g}"
    return Finding(
        decision=decision,
        reason=reason,
        lag_s=float(tally.lag_s[best]),
        correlation=float(tally.correlation[best]),
        clock_ppm=_clock_ppm(tally, best),
        idle_ratio=label.idle_ratio,
        seconds_used=float(tally.seconds[best]),
        search_size=size,
        candidates=_candidates(tally, ranked or [best]),
        warnings=(NO_LR,),
    )


@dataclass(frozen=True)
class Metric(HypothesisMatcher):
    """One of the paper's metrics as a matcher."""

    enf_method = "paper"

    number: int

    def __call__(
        self, hypotheses: Hypotheses, grids: Sequence[Grid], settings: MatchSettings
    ) -> Finding:
        """Compare with the one reference given.

        Raises
        ------
        UsageError
            If there are several references.
        """
        grid = the_only(grids, f"metric{self.number}")
        candidates = hypotheses.of_nominal(grid.nominal_hz)
        if not candidates.labels:
            other_hz = hypotheses.labels[0].nominal_hz
            reason = f"only lines of a {other_hz:.0f} Hz grid were looked at"
        elif not (reason := too_short(candidates.seconds, settings)):
            return replace(metric(paper_search(candidates, grid, settings), self.number), grid=grid)
        return Finding(decision="no_decision", reason=reason)


def _is_allowed(label: Label, number: int) -> bool:
    if number == 1:
        return label.idle_ratio == 0.0 and label.harmonic == 1 and label.line_m == 0
    return number != 2 or label.idle_ratio == 0.0


def _by_agreement(tally: Tally, threshold: float) -> list[int]:
    """Rank lags by the number of hypotheses that agree and by their best correlation.

    All lags within 1 s of a lag are its group, whatever their correlation, if the best of them is
    above the threshold. Groups are ranked by ``√(n² + ρ²)``, with both divided by their maximum
    (paper, Eq. 25). Returns the best hypothesis of each group, the best group first.
    """
    known = np.flatnonzero(np.isfinite(tally.lag_s))
    lag_s, correlation = tally.lag_s[known], tally.correlation[known]
    together = np.abs(lag_s[:, None] - lag_s) <= GROUP_S + 1e-6
    in_group = np.where(together, correlation, -np.inf)
    champion, greatest = in_group.argmax(axis=1), in_group.max(axis=1)
    groups = np.flatnonzero(greatest > threshold)
    if not groups.size:
        return []
    count = together.sum(axis=1)[groups]
    distance = np.hypot(count / count.max(), greatest[groups] / greatest[groups].max())
    order = groups[np.lexsort((-greatest[groups], -distance))]
    return list(dict.fromkeys(known[champion[order]].tolist()))


def _clock_ppm(tally: Tally, i: int) -> float:
    """Clock error by a hypothesis; NaN at ``2·f_0``, where the harmonic is uncertain."""
    label = tally.hypotheses.labels[i]
    sure = label.harmonic == 1
    return -float(tally.offset_hz[i]) / label.nominal_hz * 1e6 if sure else float("nan")


def _candidates(tally: Tally, ranked: list[int]) -> tuple[Candidate, ...]:
    """Return the best of each group of lags, in the given order."""
    out: list[int] = []
    for i in ranked:
        if len(out) < tally.settings.candidates and all(
            abs(tally.lag_s[i] - tally.lag_s[j]) > GROUP_S for j in out
        ):
            out.append(i)
    return tuple(
        Candidate(
            lag_s=float(tally.lag_s[i]),
            correlation=float(tally.correlation[i]),
            clock_ppm=_clock_ppm(tally, i),
            seconds_used=float(tally.seconds[i]),
        )
        for i in out
    )
