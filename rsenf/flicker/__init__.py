"""Flicker: tracks the phase of the mains light's flicker in row means, second by second.

In: row blocks of one stream. Out: a :class:`FlickerSecond` for every second: phase and frequency of
the illumination with their variance, and corrected frame times. The estimators of the ENF and of
the idle period share it. Read in this order::

    lines, regular_clock, slow_time    rows to a few values a frame; their times, and a buffer
    tone, acquire                      periodogram; detection of flicker, its grid and read-out axis
    grid_prior, phase_likelihood       prior of the phase, tests of its wander; sums at nodes
    phase_fit, joint_fit               posterior mode of the phase in a window
    frame_slips, slipping_fit          lost or repeated frames that time stamps don't show
    cell_light, mains                  tests for mains light against patterns and quartz
    phase_tracker                      tracking from window to window
    zero_alias_*, near_dc              alias near 0 Hz: texture and flicker fitted jointly
    rate_conversion, picture_news, conversions    converted frame rates
    second, follower                   the result; the whole stream, for one stage or two
    frame_rate                         frame rate of rows without times
"""

from rsenf.flicker.second import FlickerSecond

__all__ = ["FlickerSecond"]
