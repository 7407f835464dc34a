"""Throughput of the pipeline beside a bare decoder, and how many feeds a machine carries.

::

    films        the videos that are decoded
    graphs       a graph started as ``rsenf run`` does, and observed while it runs
    contestants  everything that is timed over a film, in turns
    feeds        feeds added until one falls behind
    table        records of the turns as tables
"""
