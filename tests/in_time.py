"""Whether something was quick enough, for a machine as slow as this one is now."""

from __future__ import annotations

from rsenf.run.process import slowness


def in_time(took_s: float, limit_s: float) -> bool:
    """Whether it took less than an idle machine may; only who took longer pays for the measure."""
    return took_s < limit_s or took_s < limit_s * slowness()
