"""Calibration of the matcher's likelihood ratios, on searches of real grids with a known answer.

grids      which stretches of measured grids calibrate, and which only test
clips      a clip's phases, as an estimator might have found them, with its errors drawn
searches   one clip searched for where it is and where it isn't
fit        the line from raw to calibrated ratios, and how reliable they are then
table      what came of it, in words
"""
