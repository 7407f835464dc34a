"""Every lag of a reference compared by plain loops: slow, and plainly right."""

from __future__ import annotations

import math

INDEPENDENT_S = 10.0  # half of the 20 s for which a grid remembers


def all_lags(enf_hz, first_s, hop_s, nominal_hz, grid, *, least_s, clock_scale_ppm):
    """Compare at every lag.

    Returns a list of ``(lag_s, score, inside)``: the clip's start, its score, and whether all of
    the clip lies within the reference's span. Lags with too few pairs have the score None.
    """
    there = [v for v in enf_hz if math.isfinite(v)]
    mean = math.fsum(there) / len(there)
    ordinary = max(2 * math.fsum((v - mean) ** 2 for v in there) / len(there), 1e-8)
    thin = max(round(grid.step_s / hop_s), 1)
    reference = averaged(list(grid.freq_hz), max(round(hop_s / grid.step_s), 1))
    step_s = hop_s * thin
    out = []
    for start in range(min(thin, len(enf_hz))):
        own = list(enf_hz[start::thin])
        for lag in range(-(len(own) - 1), len(reference)):
            pairs = [
                (own[i], reference[i + lag])
                for i in range(len(own))
                if 0 <= i + lag < len(reference)
                and math.isfinite(own[i])
                and math.isfinite(reference[i + lag])
            ]
            lag_s = (lag + 0.5) * step_s - (first_s + start * hop_s)
            inside = 0 <= lag <= len(reference) - len(own)
            enough = len(pairs) >= max(3, math.ceil(least_s / step_s))
            score = (
                score_of(pairs, ordinary, step_s, nominal_hz, clock_scale_ppm) if enough else None
            )
            out.append((lag_s, score, inside))
    return out


def averaged(values, many):
    """Means of so many values each, of which half must be there."""
    out = []
    for k in range(len(values) // many):
        there = [v for v in values[k * many : (k + 1) * many] if math.isfinite(v)]
        out.append(math.fsum(there) / len(there) if 2 * len(there) >= many else math.nan)
    return out


def score_of(pairs, ordinary, step_s, nominal_hz, clock_scale_ppm):
    """Gaussian residuals of unknown size about an offset with a Student prior of 3 degrees."""
    n = len(pairs)
    offset = math.fsum(x - y for x, y in pairs) / n
    var = math.fsum((x - y - offset) ** 2 for x, y in pairs) / n
    values = n * step_s / INDEPENDENT_S
    scaled = offset / nominal_hz * 1e6 / clock_scale_ppm
    size = -0.5 * max(values - 1, 0) * math.log(max(var, 1e-8) / ordinary)
    return size - 2.0 * math.log(1 + scaled**2 / 3)
