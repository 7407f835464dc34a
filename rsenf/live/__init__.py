"""Liveness detection: does a camera's flicker follow the grid now, or that of another time?

In: row blocks, ENF estimates with phase, idle estimates, and the reference while it is measured.
Out: ``Liveness`` verdicts, one a second, and ``Alarm`` messages.

Read ``settings``, ``ticks`` (time base: one tick a second) and ``stage`` (order of processing, and
the verdict: pictures that repeat or rest overrule the test) first. The test itself: ``judge``
(verdict of one epoch by limits with hysteresis), ``cusum`` (CUSUM of log-likelihood ratios, its
two hypotheses), ``bank`` (Kalman filters). Further evidence: ``past`` (the reference and the feed's
own ENF, origin of a stale picture), ``picture`` (frozen or looped pictures), ``alarms`` (jumps of
the phase, flicker amplitude and idle ratio; alarm messages).
"""

from __future__ import annotations

from rsenf.live.settings import Limits, LiveSettings
from rsenf.live.stage import Live, Silence

__all__ = ["Limits", "Live", "LiveSettings", "Silence"]
