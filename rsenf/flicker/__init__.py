"""Flicker: the mains' tone in row means, followed from frame to frame.

What estimators of the ENF and of the idle period share, and nothing of what they conclude: how a
harmonic shows down the rows (``lines``), its series at the frame rate (``slow_time``), one tone in
such a series (``tone``), and the phase of the flicker second by second (``second``).
"""

from rsenf.flicker.second import FlickerSecond

__all__ = ["FlickerSecond"]
