"""Numbers and times as JSON has them: what isn't known is null."""

from __future__ import annotations

import math

LATEST_NS = 1 << 62  # in the year 2116


def rounded(value: float, digits: int) -> float | None:
    """Round a number; None for one that isn't finite."""
    return round(value, digits) if math.isfinite(value) else None


def sensible(t_ns: int) -> int:
    """Wall clock that fits wherever times are reckoned with; 0, unknown, for none that can be."""
    return t_ns if 0 < t_ns < LATEST_NS else 0


def in_ms(t_ns: int) -> int | None:
    """Wall clock in ms; None for an unknown time."""
    return sensible(t_ns) // 1_000_000 or None
