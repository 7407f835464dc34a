"""Time of recording: films made once and cut into clips, and every matcher on every clip.

From a seed to a table::

    plan           which films: kinds, cameras, lamps, seeds
    references     the grid's day that the light follows, and what a clip is searched in
    films          filmed once; the rows of every coding kept on the disk
    trials         every matcher on every piece of a film and reference, against the truth
    table, text    records to the tables, beside the paper's figures
"""
