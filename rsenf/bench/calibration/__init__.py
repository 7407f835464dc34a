"""Calibration of the matcher's likelihood ratios, on searches of real grids with a known answer.

::

    clips        a clip's phases with simulated errors of estimation
    real_clips   luminance of a real camera, degraded and tracked
    searches     one clip searched for in a reference with its time, and in one without
    fit          the line from raw to calibrated ratios, and its reliability
    table        counts of decisions, reliability, and their picture
"""
