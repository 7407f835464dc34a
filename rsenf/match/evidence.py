"""What a best fit is worth: against other times, against chance, and in itself.

Three questions, none of which a threshold on the correlation answers:

* Is there another time that fits nearly as well? A likelihood ratio of the best two.
* Would the best of so many *wrong* times fit this well? The scores of wrong lags have an
  exponential upper tail (a residual variance ``V`` made of ``d`` components of the grid falls
  below ``v`` with a chance that goes as ``v^(d/2)``, and the score is a logarithm of ``V``).
  Its rate is learned from the other peaks of the same search, so that a quiet clip, a short one or
  a larger reference ask for a better fit by themselves.
* Is the fit as good as the estimates' errors say it should be? An F test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.match.score import Peak, independent_values
from rsenf.match.search import Search
from rsenf.match.series import Track
from rsenf.match.settings import MatchSettings

# The prior of the tail: as much knowledge as three peaks hold, of a mean excess over the threshold
# that grows with the root of the number of independent values. On half a day of the continental
# grid and a day of the US one, for clips of 1 to 10 minutes, the mean was 0.45 to 0.66 times it.
PRIOR_PEAKS = 3.0
PRIOR_EXCESS = 0.6
# Degrees of freedom of the expected variance: an honest guess within a factor of two or so.
EXPECTED_DOF = 4.0
# The likelihood ratio that the calibration can vouch for: it had about a thousand pairs.
MAX_VERBAL_LOG10 = 3.0

SCALE = (  # ENFSI Guideline for Evaluative Reporting in Forensic Science, 2015
    (6.0, "extremely strong support"),
    (4.0, "very strong support"),
    (3.0, "strong support"),
    (2.0, "moderately strong support"),
    (1.0, "moderate support"),
    (math.log10(2.0), "weak support"),
)


@dataclass(frozen=True)
class Evidence:
    """What speaks for the best peak of a search.

    ``log10_lr`` is against the second best, NaN when there is no other; ``chance`` is how many
    wrong lags as good as it the search should expect; ``log10_lr_absent`` is against its time not
    being in the reference; ``fit`` is the chance of so large a residual at the true time.
    """

    log10_lr: float
    chance: float
    log10_lr_absent: float
    fit: float
    expected_var_hz2: float


def weigh(found: Search, track: Track, settings: MatchSettings) -> Evidence:
    """Weigh the best peak of a search that has one."""
    best, others = found.peaks[0], found.peaks[1:]
    chance = track.hypotheses * expected_chance_fits(found, track.resolution_s)
    fit, expected = fit_of(best, found, track, settings)
    # A residual as large as the median one is no evidence against this time.
    against = min(0.0, math.log10(max(2.0 * fit, 1e-300)))
    return Evidence(
        log10_lr=(best.score - others[0].score) / math.log(10.0) if others else math.nan,
        chance=chance,
        log10_lr_absent=_log10_lr_of_chance(chance) + against,
        fit=fit,
        expected_var_hz2=expected,
    )


def expected_chance_fits(found: Search, resolution_s: float) -> float:
    """How many wrong lags at least as good as the best one a search like this should find.

    With the excesses ``e_i`` of the ``K`` best other peaks over the one after them, and a gamma
    prior worth ``k0`` peaks of excess ``m``, the predictive tail is
    ``K · (1 + s / (Σe_i + k0·m))^−(K + k0)`` at excess ``s``: an exponential whose rate is only as
    well known as there are peaks.
    """
    best, others = found.peaks[0], [p.score for p in found.peaks[1:]]
    if not others:
        return math.inf
    tail = min(max(found.tail, 1), max(len(others) - 1, 1))
    threshold = others[min(tail, len(others) - 1)]
    values = independent_values(best.seconds, resolution_s)
    known = sum(s - threshold for s in others[:tail])
    known += PRIOR_PEAKS * PRIOR_EXCESS * math.sqrt(max(values, 1.0))
    return float(tail * (1.0 + (best.score - threshold) / known) ** -(tail + PRIOR_PEAKS))


def fit_of(peak: Peak, found: Search, track: Track, settings: MatchSettings) -> tuple[float, float]:
    """Chance of a residual as large as a peak's at the true time, and the variance expected.

    Expected is the estimates' own variance and the reference's. Estimates carry their variance
    about the grid's 1 s mean; comparing with an averaged reference saves what averaging changes.
    The sizes of errors are only roughly known, hence an F test and not a chi-squared one.

    Returns
    -------
    fit : float
        Between 0 and 1.
    expected_var_hz2 : float
    """
    from scipy.special import fdtrc

    own = track.var_hz2[np.isfinite(track.var_hz2)]
    own_var = max(float(own.mean()) - found.way.smear_var_hz2, 0.0) if own.size else 0.0
    expected = own_var + settings.reference_std_hz**2
    freedom = max(independent_values(peak.seconds, track.resolution_s) - 1.0, 1.0)
    return float(fdtrc(freedom, EXPECTED_DOF, peak.residual_var_hz2 / expected)), expected


def _log10_lr_of_chance(chance: float) -> float:
    """Turn an expected number of chance fits into a likelihood ratio, on the cautious side.

    A significance ``p`` supports a likelihood ratio of at most ``1 / (−e·p·ln p)`` (Sellke, Bayarri
    & Berger, The American Statistician 55, 2001); ``1/p`` would overstate it.
    """
    p = max(-math.expm1(-chance), 1e-300)
    return -math.log10(-math.e * p * math.log(p)) if p < 1 / math.e else 0.0


def verbal(log10_lr: float, what: str = "this time") -> str:
    """Return the likelihood ratio of ``what`` in the words that forensic institutes use."""
    if math.isnan(log10_lr):
        return ""
    size = min(abs(log10_lr), MAX_VERBAL_LOG10)
    side = f"for {what}" if log10_lr > 0 else f"against {what}"
    for limit, words in SCALE:
        if size >= limit:
            return f"{words} {side}"
    return "no support either way"
