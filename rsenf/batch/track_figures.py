"""A recording's ENF in a few figures."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from typing import Any

from rsenf.messages import EnfEstimate


def track_figures(estimates: Sequence[EnfEstimate], frame_rate_hz: float) -> dict[str, Any]:
    """Return how many values there are, and what the usable ones come to.

    The mean's standard error is the mean of theirs: their errors may be one and the same, as where
    windows overlap, and then averaging gains nothing.

    Parameters
    ----------
    estimates : sequence of EnfEstimate
    frame_rate_hz : float
        Of the camera, over all of the recording.
    """
    usable = [e for e in estimates if e.usable]
    figures: dict[str, Any] = {"values": len(estimates), "usable_values": len(usable)}
    if not usable:
        return figures
    enf_hz = [e.enf_hz for e in usable]
    std_hz = [math.sqrt(e.enf_var_hz2) for e in usable if e.enf_var_hz2 >= 0.0]
    snr_db = [e.snr_db for e in usable if math.isfinite(e.snr_db)]
    last = usable[-1]
    return figures | {
        "enf_mean_hz": statistics.fmean(enf_hz),
        "enf_mean_std_hz": statistics.fmean(std_hz) if std_hz else None,
        "enf_min_hz": min(enf_hz),
        "enf_max_hz": max(enf_hz),
        "enf_std_median_hz": statistics.median(std_hz) if std_hz else None,
        "snr_median_db": statistics.median(snr_db) if snr_db else None,
        "nominal_hz": last.nominal_hz,
        "harmonic": last.harmonic,
        "line_hz": last.line_hz,
        "frame_rate_hz": frame_rate_hz,
    }
