"""Flicker: tracks the phase of the mains light's flicker in row means, second by second.

In: row blocks of one stream. Out: a :class:`FlickerSecond` for every second: phase and frequency of
the illumination with their variance, and corrected frame times. The estimators of the ENF and of
the idle period share it. Read in this order::

    lines, profile, slow_time          a harmonic down the rows; reduced profiles; timed buffer
    tone, acquire                      periodogram; detection of flicker and its grid
    grid_prior, node_sums, phase_likelihood    prior of the phase; sums at nodes; likelihood
    phase_fit, joint_fit               posterior mode of the phase in a window
    frame_slips, slipping_fit          lost or repeated frames that time stamps don't show
    cell_light, wander, mains          tests for mains light against patterns and quartz
    phase_path, phase_tracker          tracking from window to window
    zero_alias_*, near_dc_*            alias near 0 Hz: texture and flicker fitted jointly
    frame_clock                        jittering time stamps
    rate_conversion, picture_news, conversions    converted frame rates
    second, follower, shared           the result; the whole stream; one follower for two stages
    axis, frame_rate                   read-out axis; frame rate of rows without times
"""

from rsenf.flicker.second import FlickerSecond

__all__ = ["FlickerSecond"]
