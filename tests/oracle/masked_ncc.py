"""The masked cross-correlation, one lag and one pair at a time: slow, and plainly right."""

from __future__ import annotations

import math


def masked_ncc(x, x_ok, y, y_ok, min_pairs=3):
    """Return ``{lag: (pairs, correlation, offset, residual variance)}`` for every overlap."""
    out = {}
    for lag in range(-(len(x) - 1), len(y)):
        pairs = [
            (x[i], y[i + lag])
            for i in range(len(x))
            if 0 <= i + lag < len(y) and x_ok[i] and y_ok[i + lag]
        ]
        out[lag] = (len(pairs), *_statistics(pairs)) if len(pairs) >= min_pairs else None
    return out


def _statistics(pairs):
    n = len(pairs)
    mean_x = math.fsum(a for a, _ in pairs) / n
    mean_y = math.fsum(b for _, b in pairs) / n
    var_x = math.fsum((a - mean_x) ** 2 for a, _ in pairs) / n
    var_y = math.fsum((b - mean_y) ** 2 for _, b in pairs) / n
    cov = math.fsum((a - mean_x) * (b - mean_y) for a, b in pairs) / n
    offset = math.fsum(a - b for a, b in pairs) / n
    residual = math.fsum((a - b - offset) ** 2 for a, b in pairs) / n
    correlation = cov / math.sqrt(var_x * var_y) if var_x > 1e-18 and var_y > 1e-18 else None
    return correlation, offset, residual
