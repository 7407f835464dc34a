"""Numbers and times for JSON; unknown values are null."""

from __future__ import annotations

import math

LATEST_NS = 1 << 62  # in the year 2116


def rounded(value: float, digits: int) -> float | None:
    """Round a number; None if it isn't finite.

    Examples
    --------
    >>> rounded(50.01234, 3), rounded(float("nan"), 3)
    (50.012, None)
    """
    return round(value, digits) if math.isfinite(value) else None


def sensible(t_ns: int) -> int:
    """Return a wall-clock time; 0 (unknown) if it isn't between 1970 and LATEST_NS."""
    return t_ns if 0 < t_ns < LATEST_NS else 0


def in_ms(t_ns: int) -> int | None:
    """Convert a wall-clock time to ms; None if unknown."""
    return sensible(t_ns) // 1_000_000 or None
