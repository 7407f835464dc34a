"""Blind discovery: effects hidden in simulated recordings, and what the workflow says of each.

From a seed to a table::

    plan           which cases: one effect, two, none, or one that isn't in the catalogue
    scene          camera, lamp, grid and effects of a case, drawn from its seed
    trial          a case simulated, given to the workflow, and compared with its truth
    beside         cases of a clock error, with a reference of the grid
    judge          outcome of an answer, and errors of its parameters
    table          records to rates, and the confusion matrix

and on a camera that shares no code with rsenf's own model::

    foreign        the camera loaded, its cases, one of them tried
    foreign_table  records to rates, against the marks
"""
