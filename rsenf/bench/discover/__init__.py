"""Blind discovery: effects hidden in simulated recordings, and what the workflow says of each.

From a seed to a table, one idea a file::

    plan       which cases there are: one effect, two, none, or one that no catalogue has
    scene      camera, lamp, grid and effects of a case, drawn from its seed
    outside    effects that aren't in the catalogue, by plain array arithmetic
    trial      a case made, given to the workflow, and its truth opened
    beside     cases of a clock that is off, or isn't, which come with a reference of the grid
    judge      what an answer is worth
    table      records to rates
    picture    what was hidden against what was named

and on a camera that shares nothing with rsenf's own model::

    foreign        the camera loaded, its cases, one of them tried
    foreign_judge  what an answer is worth, and how far off sizes are
    foreign_table  records to rates, and to the marks that are to be reached
"""
