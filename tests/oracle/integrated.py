"""Phase of a light by integrating its frequency sample by sample: slow, and plainly right."""

from __future__ import annotations

import math

RAD_PER_CYCLE = 4 * math.pi  # the light flickers at twice the grid's frequency


def turned_rad(freq_hz, nominal_hz, step_s, begin_s, end_s, parts=200):
    """Phase less the nominal frequency's from one instant to a later one; None across a gap."""
    total = 0.0
    for k in range(math.floor(begin_s / step_s), math.ceil(end_s / step_s)):
        if not 0 <= k < len(freq_hz) or math.isnan(freq_hz[k]):
            return None
        a, b = max(begin_s, k * step_s), min(end_s, (k + 1) * step_s)
        width = (b - a) / parts
        for j in range(parts):
            within = ((a + (j + 0.5) * width) / step_s) - k
            total += width * (frequency(freq_hz, k, within) - nominal_hz)
    return RAD_PER_CYCLE * total


def frequency(freq_hz, k, within):
    """Frequency at a share of a sample: a line through its mean, as steep as those beside it."""
    beside = [freq_hz[i] if 0 <= i < len(freq_hz) else math.nan for i in (k - 1, k + 1)]
    slope = (beside[1] - beside[0]) / 2
    return freq_hz[k] + (0.0 if math.isnan(slope) else slope * (within - 0.5))
