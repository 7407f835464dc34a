"""An archive: recordings by site, camera and day, with rotation, retention and an index.

Writing: ``layout`` (file names), ``camera_files`` (rotation), ``alarms`` (what is noted of them),
and ``writer``, which uses all of these, and deletes the oldest. Reading: ``index`` (summaries of
all files), ``holdings`` (coverage and gaps).
"""

from rsenf.record.archive.writer import ArchiveRecorder

__all__ = ["ArchiveRecorder"]
