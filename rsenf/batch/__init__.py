"""Batch: analyses many recordings in parallel, and keeps one result row for each.

In: files, folders or lists of recordings, and :class:`rsenf.batch.settings.Settings`. Out: a
journal (JSON Lines, one row per recording, appended as each is done), a Parquet table and an HTML
page. An interrupted run continues from its journal.

Read ``settings`` (find the recordings, check, fingerprint), ``journal`` and ``columns`` (the rows,
what is left to do, the summary) first; then ``work`` (one recording to one row), ``pool``
(processes, Dask) and ``run`` (all of it).
"""
