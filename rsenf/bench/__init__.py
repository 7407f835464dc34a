"""Benchmarks: every method on the same clips, each clip with its truth.

From a seed to a table, in the order in which a run passes through::

    plan         which clips are filmed: cells and seeds
    scenes       what each shows: a wall in a lamp's light on a grid, or a scene without an ENF
    judge        all methods on the same row blocks, against the truth
    measure      one clip rendered, encoded, decoded and judged: from its seed to its record
    harness      tasks in worker processes, a journal from which a run resumes, the machine
    tables       columns aligned or in Markdown, medians, confidence bounds, pictures
    benchmarks   every benchmark by name: its line of help, options, settings and module
    clip_tables, clip_text
                 records of clips to the tables of idle, enf and claims
    cameras_table
                 fleets of cameras drawn from the same records

A benchmark is a module with a function ``measure``, from a :class:`rsenf.bench.harness.Run` to a
:class:`rsenf.bench.harness.Made`; the rest is the harness's. Benchmarks with a plan of their own::

    match_days, match_trial
                 a long reference; searches of it timed, and their tables
    recording_time, calibration, live, discover, foreign, pipeline, tracker
"""
