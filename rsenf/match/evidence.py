"""Weighs the best fit of a search: against other times, against chance, and on its own.

Three tests, none of which is a threshold on the correlation:

* Does another time fit nearly as well? The likelihood ratio of the best two peaks.
* Would the best of this many *wrong* lags fit as well by chance? The scores of wrong lags have an
  exponential upper tail: a residual variance ``V`` made of ``d`` components of the grid is below
  ``v`` with a probability that goes as ``v^(d/2)``, and the score is a logarithm of ``V``. The
  rate of the tail is estimated from the other peaks of the same search. So a quiet clip, a short
  clip or a larger reference need a better fit without further settings.
* Is the residual as small as the estimates' stated errors imply? An F test.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rsenf.match.score import Peak, independent_values
from rsenf.match.search import Search
from rsenf.match.series import Track
from rsenf.match.settings import MatchSettings

# Gamma prior of the tail: worth three peaks; its mean excess over the threshold is PRIOR_EXCESS
# times the root of the number of independent values. On half a day of the continental grid and a
# day of the US one, for clips of 1 to 10 minutes, this factor was 0.45 to 0.66.
PRIOR_PEAKS = 3.0
PRIOR_EXCESS = 0.6
# Degrees of freedom of the expected variance, which is known within a factor of about two.
EXPECTED_DOF = 4.0
# Largest log10 likelihood ratio that the calibration supports: it had about a thousand pairs.
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
    """Evidence for the best peak of a search.

    ``log10_lr`` is against the second best peak (NaN without one) and ``log10_lr_absent`` against
    the true time not being in the reference. ``chance`` is the expected number of wrong lags in the
    search that fit at least as well, and ``fit`` the probability of so large a residual at the true
    time, where ``expected_var_hz2`` is its expected variance.
    """

    log10_lr: float
    chance: float
    log10_lr_absent: float
    fit: float
    expected_var_hz2: float


def weigh(found: Search, track: Track, settings: MatchSettings) -> Evidence:
    """Weigh the best peak of a search; the search must have one."""
    best, others = found.peaks[0], found.peaks[1:]
    chance = track.hypotheses * expected_chance_fits(found, track.resolution_s)
    fit, expected = fit_of(best, found, track, settings)
    # A residual up to the median is no evidence against this time.
    against = min(0.0, math.log10(max(2.0 * fit, 1e-300)))
    return Evidence(
        log10_lr=(best.score - others[0].score) / math.log(10.0) if others else math.nan,
        chance=chance,
        log10_lr_absent=_log10_lr_of_chance(chance) + against,
        fit=fit,
        expected_var_hz2=expected,
    )


def expected_chance_fits(found: Search, resolution_s: float) -> float:
    """Return the expected number of wrong lags that fit at least as well as the best peak.

    With the excesses ``e_i`` of the ``K`` next best peaks over the one after them, and a gamma
    prior worth ``k0`` peaks of excess ``m``, the predictive tail at an excess ``s`` is
    ``K · (1 + s / (Σe_i + k0·m))^−(K + k0)``: an exponential tail whose rate is uncertain.
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
    """F test of a peak's residual: the probability of one so large at the true time.

    The expected variance is that of the estimates and of the reference. Estimates state their
    variance about the grid's 1 s mean; if the reference was averaged like them, the part that
    averaging explains is subtracted. An F test and not a chi-squared test, since the sizes of the
    errors are known only roughly.

    Returns
    -------
    fit : float
        Between 0 and 1.
    expected_var_hz2 : float
    """
    from scipy.special import fdtrc

    var = track.var_hz2[np.isfinite(track.var_hz2)]
    estimate_var = max(float(var.mean()) - found.way.smear_var_hz2, 0.0) if var.size else 0.0
    expected = estimate_var + settings.reference_std_hz**2
    freedom = max(independent_values(peak.seconds, track.resolution_s) - 1.0, 1.0)
    return float(fdtrc(freedom, EXPECTED_DOF, peak.residual_var_hz2 / expected)), expected


def _log10_lr_of_chance(chance: float) -> float:
    """Convert an expected number of chance fits to a conservative log10 likelihood ratio.

    A significance ``p`` supports a likelihood ratio of at most ``1 / (−e·p·ln p)`` (Sellke, Bayarri
    & Berger, The American Statistician 55, 2001); ``1/p`` would overstate it.
    """
    p = max(-math.expm1(-chance), 1e-300)
    return -math.log10(-math.e * p * math.log(p)) if p < 1 / math.e else 0.0


def verbal(log10_lr: float, what: str = "this time") -> str:
    """Return a likelihood ratio in words, on the scale of the ENFSI guideline (2015).

    Parameters
    ----------
    log10_lr : float
        NaN gives an empty text. Support is capped at :data:`MAX_VERBAL_LOG10`.
    what : str
        The proposition that the ratio is for.

    Examples
    --------
    >>> verbal(2.3)
    'moderately strong support for this time'
    >>> verbal(-1.5)
    'moderate support against this time'
    """
    if math.isnan(log10_lr):
        return ""
    size = min(abs(log10_lr), MAX_VERBAL_LOG10)
    side = f"for {what}" if log10_lr > 0 else f"against {what}"
    for limit, words in SCALE:
        if size >= limit:
            return f"{words} {side}"
    return "no support either way"
