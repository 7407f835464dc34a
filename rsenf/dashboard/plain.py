"""Numbers and times as JSON has them: what isn't known is null."""

from __future__ import annotations

import math


def rounded(value: float, digits: int) -> float | None:
    """Round a number; None for one that isn't finite."""
    return round(value, digits) if math.isfinite(value) else None


def in_ms(t_ns: int) -> int | None:
    """Wall clock in ms; None for an unknown time."""
    return t_ns // 1_000_000 if t_ns else None
