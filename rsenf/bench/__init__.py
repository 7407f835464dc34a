"""Benchmarks: every method on the same clips, each clip with its truth.

From a seed to a table, one idea a file::

    plan       which clips there are: cells and seeds
    scenes     what each shows: a lit wall, or one of the scenes with nothing to claim
    grids      the grid's frequency behind the lamp: measured where there is data
    film       filmed once, encoded at every bit rate in the same pass, decoded, sampled
    judge      all methods on the same row blocks, against the truth
    bounds     the Cramér–Rao bound of the ENF, and the bound on a rate of false claims
    measure    one clip from its seed to its record
    results    the file of records, to which a run adds and from which it resumes
    workers    processes that measure clips side by side
    session    from a plan to its records: measures what the file lacks
    groups, idle_table, enf_table, claims_table, document
               records to the rows of the tables
    text       rows as text and as Markdown

What has a plan of its own::

    match_days, match_loop, match_trial, match_stream, match_table
               long references, a loop over their lags, searches of one with their time and memory,
               clips that come in bit by bit, and their tables
"""
