"""Detects a changed lamp, view or camera by the flicker's amplitude and the idle ratio."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.medians import median_of_few
from rsenf.messages import EnfEstimate, IdleEstimate

NEW_S = 8  # newest seconds, which are compared with the OLD_S before
OLD_S = 120
LEAST_S = 30  # least number of earlier seconds
SURE_STDS = 8.0
LEAST_LOG = math.log(1.3)  # clouds and people change the amplitude by less
MAD_TO_STD = 1.4826  # standard deviation of a normal over its median absolute deviation
# Smallest difference of two idle ratios, beside their intervals: a codec shifts them by some tenths
# of a percentage point.
LEAST_IDLE = 0.01


@dataclass(frozen=True)
class Change:
    """A changed quantity: its value, the value before, and the limit that was exceeded."""

    value: float
    before: float
    limit: float


class FlickerSize:
    """Compares the flicker's amplitude with that of the minutes before, on a log scale.

    A change is reported if all of the newest values differ from the median in the same direction,
    by more than 8 robust standard deviations (median absolute deviation) and a factor of 1.3.
    """

    def __init__(self) -> None:
        self._log: deque[float] = deque(maxlen=OLD_S + NEW_S)

    def take(self, estimate: EnfEstimate) -> Change | None:
        """Take an estimate; return the factor by which the amplitude has changed, if it has."""
        size = math.hypot(float(estimate.amplitude_re[0]), float(estimate.amplitude_im[0]))
        if size <= 0.0:
            return None
        self._log.append(math.log(size))
        if len(self._log) < LEAST_S + NEW_S:
            return None
        every = np.array(self._log)
        old, new = every[:-NEW_S], every[-NEW_S:]
        middle = float(median_of_few(old))
        scatter = MAD_TO_STD * float(median_of_few(np.abs(old - middle)))
        limit = max(SURE_STDS * scatter, LEAST_LOG)
        away = new - middle
        if not (np.abs(away) > limit).all() or abs(away.sum()) != np.abs(away).sum():
            return None
        return Change(math.exp(float(np.median(away))), 1.0, math.exp(limit))


class IdlePeriod:
    """Compares each idle estimate with an older one."""

    def __init__(self) -> None:
        self._known: IdleEstimate | None = None

    def take(self, estimate: IdleEstimate) -> Change | None:
        """Take an estimate; return the change, if it is incompatible with the older one."""
        if estimate.verdict != "estimated" or not math.isfinite(estimate.idle_ratio):
            return None
        known = self._known
        if known is None:
            self._known = estimate
            return None
        apart = abs(estimate.idle_ratio - known.idle_ratio)
        limit = max(_half(estimate) + _half(known), LEAST_IDLE)
        # An estimate uses the whole epoch, so after a change it moves slowly. It is therefore
        # compared with an old one, which is replaced only by a much more precise one.
        if apart > limit or _half(estimate) < _half(known) / 2.0:
            self._known = estimate
        return Change(estimate.idle_ratio, known.idle_ratio, limit) if apart > limit else None


def _half(estimate: IdleEstimate) -> float:
    """Return half the width of the 95 % interval."""
    return (estimate.idle_ratio_high - estimate.idle_ratio_low) / 2.0
