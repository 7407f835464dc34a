"""Is it still the same camera under the same lamp? By the flicker's size, and the idle period."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from rsenf.medians import median_of_few
from rsenf.messages import EnfEstimate, IdleEstimate

NEW_S = 8  # seconds whose flicker is compared with that of the minutes before
OLD_S = 120
LEAST_S = 30  # of those, before anything is compared
SURE_STDS = 8.0
LEAST_LOG = math.log(1.3)  # clouds and people move a flicker's size by less
MAD_TO_STD = 1.4826
# By how much two idle ratios must differ beside being incompatible: a codec shifts them by some
# tenths of a percentage point.
LEAST_IDLE = 0.01


@dataclass(frozen=True)
class Change:
    """A quantity that isn't what it was: its value, what it was, and the limit for either."""

    value: float
    before: float
    limit: float


class FlickerSize:
    """Compares the flicker's amplitude with what it was in the minutes before."""

    def __init__(self) -> None:
        self._log: deque[float] = deque(maxlen=OLD_S + NEW_S)

    def take(self, estimate: EnfEstimate) -> Change | None:
        """Take an estimate; return by which factor the flicker's size has changed, if it has."""
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
        """Take an estimate; return the change, if it is another camera's."""
        if estimate.verdict != "estimated" or not math.isfinite(estimate.idle_ratio):
            return None
        known = self._known
        if known is None:
            self._known = estimate
            return None
        apart = abs(estimate.idle_ratio - known.idle_ratio)
        limit = max(_half(estimate) + _half(known), LEAST_IDLE)
        # Estimates are of all that an epoch has seen, so they move slowly after a change: each is
        # compared with one of long ago, which only one that knows much better takes the place of.
        if apart > limit or _half(estimate) < _half(known) / 2.0:
            self._known = estimate
        return Change(estimate.idle_ratio, known.idle_ratio, limit) if apart > limit else None


def _half(estimate: IdleEstimate) -> float:
    """Half the 95 % interval's width."""
    return (estimate.idle_ratio_high - estimate.idle_ratio_low) / 2.0
