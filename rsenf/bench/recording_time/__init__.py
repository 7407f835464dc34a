"""Time of recording: films made once and cut into clips, and every matcher on every clip.

From a seed to a table, one idea a file::

    plan           which films there are: kinds, cameras, lamps, seeds
    scene          what each shows
    days           the grid's day that the light follows, and another day
    films          filmed once, and the rows of every coding kept on the disk
    cuts           pieces of a film, each a clip of its own
    references     what a piece is searched in: its time present, and absent
    trials         every matcher on every piece and reference, against the truth
    session        what is missing of films and trials
    table, quality_table, document
                   records to the rows of the tables
    paper          the paper's published figures, and the marks to reach
    text           the tables as text and as Markdown
"""
