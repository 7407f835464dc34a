"""Rows: from frames to row blocks, the mean luma of each row's steady pixels.

In: ``Frame`` with its luma plane. Out: ``RowBlock``, the row means of some consecutive frames per
strip of the picture's width, sampled at rows × frame rate (paper, Section III-B). Pixels touched
by motion are left out.

Read ``steady`` (sums over the pixels, background model and mask), ``stabilise`` (of a picture that
moves as a whole), then ``stage`` (rows, columns or whichever shows the flicker; also row blocks of
arrays that another program sampled). ``settings`` has the options.
"""
