"""An archive: recordings by site, camera and day, with rotation, retention and an index.

Writing: ``layout`` (file names), ``camera_files`` (rotation), ``alarm_files`` (only the minutes
around alarms), ``alarms`` (time spans exempt from retention), ``retention``, and ``writer``, which
uses all of these. Reading: ``summary`` (one file), ``index`` (all files, cached), ``holdings``
(coverage and gaps).
"""

from rsenf.record.archive.writer import ArchiveRecorder

__all__ = ["ArchiveRecorder"]
