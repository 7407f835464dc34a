"""Rows: from frames to row blocks, the mean luma of each row's steady pixels.

In: ``Frame`` with its luma plane. Out: ``RowBlock``, the row means of some consecutive frames per
strip of the picture's width, sampled at rows × frame rate (paper, Section III-B). Pixels touched
by motion are left out.

Read ``tiles`` (sums over the pixels), ``steady`` (background model and mask), ``stage`` (both
together), then ``auto`` (detects the read-out axis). ``settings`` has the options; ``luminance``
makes row blocks of arrays sampled by another program.
"""
