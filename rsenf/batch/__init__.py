"""Batch: analyses many recordings in parallel, and keeps one result row for each.

In: files, folders or lists of recordings, and :class:`rsenf.batch.settings.Settings`. Out: a
journal (JSON Lines, one row per recording, appended as each is done), a Parquet table and an HTML
page. An interrupted run continues from its journal.

Read ``recordings`` (find the files), ``settings`` (check, fingerprint), ``journal`` and ``plan``
(what is left to do) first; then ``work`` (one recording to one row, ``columns``), ``pool`` and
``cluster`` (processes, Dask), ``run`` (all of it) and ``summary`` (texts, exit code).
"""
